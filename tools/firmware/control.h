/* What the board does with what it is told: limits, slew rate, watchdog. Pure C, without registers: the same file runs
   on the chip and in the tests.

   Pulses are in tenths of a microsecond, slew rates in microseconds a second, axis 0 is beta, 1 is gamma. */

#ifndef MAZEPLAN_CONTROL_H
#define MAZEPLAN_CONTROL_H

#include "frame.h"

#define AXES 2
#define TICK_MS 5               /* control_tick() comes so often */
#define WATCHDOG_MS 200         /* without a valid command, after which the plate is levelled */
#define FRAME_MS 20             /* control_pulse() comes so often: one servo pulse */

/* No frame widens these: most servos are at their stops at 500 and 2500 us. */
#define HARD_MIN 8000
#define HARD_MAX 22000
#define HARD_SLEW 20000
#define MIDDLE 15000            /* the level pulse until the host has sent its own */

enum control_flags {
    FLAG_WATCHDOG = 1,          /* struck; the next valid command takes it away */
    FLAG_UNSET = 2,             /* no limits yet, so commands are refused */
    FLAG_LEVEL = 4,             /* held level: by request, by the watchdog or since the start */
    FLAG_CLAMPED = 8,           /* the last command was outside the limits */
    FLAG_MOVING = 16            /* the slew rate holds the pulse back */
};

enum control_answer { ANSWER_NONE, ANSWER_IDENTITY, ANSWER_LIMITS, REFUSED_KIND, REFUSED_FIELDS, REFUSED_RANGE,
                      REFUSED_UNSET };

struct limits {
    uint16_t min, max, level, slew;
};

struct axis {
    struct limits limits;
    uint32_t target, now;       /* in fiftieths of a microsecond: a slew rate in us/s is then the step of 20 ms */
};

struct control {
    struct axis axis[AXES];
    uint8_t set;                /* bit for each axis whose limits the host has sent */
    uint8_t flags;
    uint8_t quiet;              /* ticks since the last valid command */
    uint16_t accepted;          /* sequence number of the last command or level request that was accepted */
    uint16_t strikes;           /* of the watchdog since the start */
};

/* Everything level. `kept`: limits of before a restart, whose level pulses are taken, or NULL. */
void control_start(struct control *control, const struct limits *kept);

/* Do what a message asks for. */
enum control_answer control_message(struct control *control, const struct message *message);

/* Every TICK_MS; true when the watchdog strikes. */
bool control_tick(struct control *control);

/* Every FRAME_MS: one step further, then the pulses in half microseconds. */
void control_pulse(struct control *control, uint16_t half_us[AXES]);

/* The pulse of an axis that goes out now, tenths of a microsecond. */
uint16_t control_now(const struct control *control, uint8_t axis);

#endif
