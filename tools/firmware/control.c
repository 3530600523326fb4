#include "control.h"

#include <stddef.h>

#define FINE 5 /* of the positions' units in a tenth of a microsecond */

static uint16_t between(uint16_t x, uint16_t low, uint16_t high)
{
    return x < low ? low : x > high ? high : x;
}

static void hold_level(struct control *control)
{
    uint8_t i;

    for (i = 0; i < AXES; i++)
        control->axis[i].target = control->axis[i].now = (uint32_t)FINE * control->axis[i].limits.level;
    control->flags = (uint8_t)((control->flags & ~(FLAG_MOVING | FLAG_CLAMPED)) | FLAG_LEVEL);
}

void control_start(struct control *control, const struct limits *kept)
{
    uint8_t i;

    for (i = 0; i < AXES; i++) {
        struct limits *limits = &control->axis[i].limits;

        limits->min = HARD_MIN;
        limits->max = HARD_MAX;
        limits->slew = HARD_SLEW;
        limits->level = kept ? between(kept[i].level, HARD_MIN, HARD_MAX) : MIDDLE;
    }
    control->set = 0;
    control->quiet = 0;
    control->accepted = 0;
    control->strikes = 0;
    control->flags = FLAG_UNSET;
    hold_level(control);
}

/* L,sequence,axis,min,max,level,slew */
static enum control_answer set_limits(struct control *control, const struct message *message)
{
    const uint16_t *value = message->value + 2;
    uint8_t number;
    struct axis *axis;

    if (message->count != 6)
        return REFUSED_FIELDS;
    if (message->value[1] >= AXES || value[0] > value[2] || value[2] > value[1] || value[3] == 0)
        return REFUSED_RANGE;
    number = (uint8_t)message->value[1];
    axis = &control->axis[number];
    axis->limits.min = between(value[0], HARD_MIN, HARD_MAX);
    axis->limits.max = between(value[1], HARD_MIN, HARD_MAX);
    axis->limits.level = between(value[2], HARD_MIN, HARD_MAX);
    axis->limits.slew = between(value[3], 1, HARD_SLEW);
    control->set |= (uint8_t)(1 << number);
    if (control->set == (1 << AXES) - 1)
        control->flags &= (uint8_t)~FLAG_UNSET;
    if (control->flags & FLAG_LEVEL) {
        hold_level(control);
    } else {
        axis->target = (uint32_t)FINE * between((uint16_t)(axis->target / FINE), axis->limits.min, axis->limits.max);
        axis->now = (uint32_t)FINE * between((uint16_t)(axis->now / FINE), axis->limits.min, axis->limits.max);
    }
    return ANSWER_LIMITS;
}

/* C,sequence,beta,gamma */
static enum control_answer command(struct control *control, const struct message *message)
{
    uint8_t i;

    if (message->count != 1 + AXES)
        return REFUSED_FIELDS;
    if (control->flags & FLAG_UNSET)
        return REFUSED_UNSET;
    control->flags &= (uint8_t)~(FLAG_WATCHDOG | FLAG_LEVEL | FLAG_CLAMPED);
    for (i = 0; i < AXES; i++) {
        struct axis *axis = &control->axis[i];
        uint16_t allowed = between(message->value[1 + i], axis->limits.min, axis->limits.max);

        if (allowed != message->value[1 + i])
            control->flags |= FLAG_CLAMPED;
        axis->target = (uint32_t)FINE * allowed;
    }
    control->quiet = 0;
    control->accepted = message->value[0];
    return ANSWER_NONE;
}

enum control_answer control_message(struct control *control, const struct message *message)
{
    switch (message->kind) {
    case 'C':
        return command(control, message);
    case 'L':
        return set_limits(control, message);
    case 'Z':
        if (message->count != 1)
            return REFUSED_FIELDS;
        control->flags &= (uint8_t)~FLAG_WATCHDOG;
        hold_level(control);
        control->accepted = message->value[0];
        return ANSWER_NONE;
    case 'I':
        return message->count == 1 ? ANSWER_IDENTITY : REFUSED_FIELDS;
    default:
        return REFUSED_KIND;
    }
}

bool control_tick(struct control *control)
{
    if (control->flags & FLAG_LEVEL)
        return false;
    if (++control->quiet < WATCHDOG_MS / TICK_MS)
        return false;
    control->flags |= FLAG_WATCHDOG;
    control->strikes++;
    hold_level(control);
    return true;
}

/* A sudden step would throw the ball; levelling does not come here, as it must not wait. */
static bool step(struct axis *axis)
{
    uint32_t most = axis->limits.slew;

    if (axis->target > axis->now + most)
        axis->now += most;
    else if (axis->now > axis->target + most)
        axis->now -= most;
    else
        axis->now = axis->target;
    return axis->now != axis->target;
}

void control_pulse(struct control *control, uint16_t half_us[AXES])
{
    uint8_t i, moving = 0;

    for (i = 0; i < AXES; i++) {
        if (step(&control->axis[i]))
            moving = FLAG_MOVING;
        half_us[i] = (uint16_t)((control->axis[i].now + FINE * 5 / 2) / (FINE * 5));
    }
    control->flags = (uint8_t)((control->flags & ~FLAG_MOVING) | moving);
}

uint16_t control_now(const struct control *control, uint8_t axis)
{
    return (uint16_t)((control->axis[axis].now + FINE / 2) / FINE);
}
