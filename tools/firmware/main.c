/* Firmware of the plate: two servo pulses out, two tilt diodes in, one serial line (docs/protocol.md). */

#include "chip.h"

#include <avr/io.h>
#include <stddef.h>
#include <util/atomic.h>

#define NAME "mazeplan"
#define PROTOCOL 1
#define VERSION "1.0"

#define REPORT_SAMPLES 2        /* of 5 ms: a report every 10 ms, ... */
#define ANSWER_SAMPLES 1        /* ... or at the next one, when a command came */
#define KEPT_MAGIC 0x4D5A

struct kept { /* outlives a reset without loss of power, so that level is where the host said */
    uint16_t magic;
    struct limits limits[AXES];
    uint16_t crc;
};

static struct control control;
static struct frame_reader reader;
static struct kept kept __attribute__((section(".noinit")));
static volatile uint8_t struck;
static uint8_t events;
static bool booted = true, answered = true;

static uint16_t kept_crc(void)
{
    const uint8_t *bytes = (const uint8_t *)kept.limits;
    uint16_t crc = 0xFFFF;
    uint8_t i;

    for (i = 0; i < sizeof kept.limits; i++)
        crc = frame_crc(crc, bytes[i]);
    return crc;
}

static void keep_limits(void)
{
    uint8_t i;

    for (i = 0; i < AXES; i++)
        kept.limits[i] = control.axis[i].limits;
    kept.crc = kept_crc();
    kept.magic = KEPT_MAGIC;
}

void on_tick(void)
{
    if (control_tick(&control))
        struck = 1;
}

void on_pulse(uint16_t half_us[AXES])
{
    control_pulse(&control, half_us);
}

/* Nothing waits for the line, as a flood would then stop the board, nor long in front of it, as a report must be new:
   where more than this many frames are under way, answers are left out, and reports and events come later. */
#define BEFORE_ANSWER 1
#define BEFORE_REPORT 2

static bool at_most(uint8_t frames)
{
    return chip_room() >= CHIP_RING - 1 - frames * FRAME_BYTES;
}

static void send(struct frame_writer *writer)
{
    uint8_t length = frame_end(writer);

    chip_send(writer->bytes, length);
}

static void send_identity(uint16_t sequence)
{
    struct frame_writer writer;

    frame_begin(&writer, 'I');
    frame_number(&writer, sequence);
    frame_text(&writer, NAME);
    frame_number(&writer, PROTOCOL);
    frame_text(&writer, VERSION);
    frame_number(&writer, HARD_MIN);
    frame_number(&writer, HARD_MAX);
    frame_number(&writer, HARD_SLEW);
    frame_number(&writer, WATCHDOG_MS);
    frame_number(&writer, chip_cause);
    send(&writer);
}

static void send_limits(uint16_t sequence, uint8_t axis)
{
    struct frame_writer writer;
    const struct limits *limits = &control.axis[axis].limits;

    frame_begin(&writer, 'L');
    frame_number(&writer, sequence);
    frame_number(&writer, axis);
    frame_number(&writer, limits->min);
    frame_number(&writer, limits->max);
    frame_number(&writer, limits->level);
    frame_number(&writer, limits->slew);
    send(&writer);
}

static void send_refusal(uint16_t sequence, enum control_answer why)
{
    struct frame_writer writer;

    frame_begin(&writer, 'N');
    frame_number(&writer, sequence);
    frame_text(&writer, why == REFUSED_KIND    ? "KIND"
                        : why == REFUSED_RANGE ? "RANGE"
                        : why == REFUSED_UNSET ? "UNSET"
                                               : "FIELDS");
    send(&writer);
}

static void obey(const char *body)
{
    struct message message;
    enum control_answer answer = REFUSED_FIELDS;
    uint16_t sequence = 0;

    if (message_parse(body, &message)) {
        sequence = message.value[0];
        ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
            answer = control_message(&control, &message);
        }
    }
    if (answer == ANSWER_NONE) {
        answered = false;
        return;
    }
    if (answer == ANSWER_LIMITS)
        keep_limits();
    if (!at_most(BEFORE_ANSWER))
        return;
    if (answer == ANSWER_IDENTITY)
        send_identity(sequence);
    else if (answer == ANSWER_LIMITS)
        send_limits(sequence, (uint8_t)message.value[1]);
    else
        send_refusal(sequence, answer);
}

static bool send_event(const char *word, uint16_t value)
{
    struct frame_writer writer;

    if (!at_most(BEFORE_REPORT))
        return false; /* and try again */
    frame_begin(&writer, 'E');
    frame_number(&writer, events++);
    frame_text(&writer, word);
    frame_number(&writer, chip_tenths());
    frame_number(&writer, value);
    send(&writer);
    return true;
}

static void tell_events(void)
{
    if (booted && send_event("BOOT", chip_cause))
        booted = false;
    if (struck && send_event("WATCHDOG", control.strikes))
        struck = 0;
}

/* The mean of all conversions since the last report, stamped with their middle. */
static void report(void)
{
    struct frame_writer writer;
    struct samples samples;
    uint16_t accepted = 0, pulse[AXES] = {0, 0}, strikes = 0;
    uint8_t i, flags = 0;

    if (!at_most(BEFORE_REPORT) || !chip_samples(&samples, answered ? REPORT_SAMPLES : ANSWER_SAMPLES))
        return;
    answered = true;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        accepted = control.accepted;
        flags = control.flags;
        strikes = control.strikes;
        for (i = 0; i < AXES; i++)
            pulse[i] = control_now(&control, i);
    }
    frame_begin(&writer, 'T');
    frame_number(&writer, accepted);
    frame_number(&writer, samples.first + (samples.last - samples.first) / 2);
    for (i = 0; i < CHANNELS; i++) /* in 1/64 of a count */
        frame_number(&writer, samples.sum[i] * (64 / CONVERSIONS) / samples.count);
    for (i = 0; i < AXES; i++)
        frame_number(&writer, pulse[i]);
    frame_number(&writer, flags);
    frame_number(&writer, strikes);
    frame_number(&writer, reader.bad);
    send(&writer);
    chip_lamp(!(flags & FLAG_LEVEL));
}

int main(void)
{
    uint8_t byte;

    control_start(&control, kept.magic == KEPT_MAGIC && kept.crc == kept_crc() ? kept.limits : NULL);
    chip_start();
    for (;;) {
        while (chip_receive(&byte)) {
            if (frame_feed(&reader, byte)) {
                obey(reader.body);
                break; /* a flood must not keep what follows from its turn */
            }
        }
        tell_events();
        report();
        chip_rest();
    }
}
