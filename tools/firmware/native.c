/* The parts of the firmware that know no registers, compiled for the machine of the tests, with sanitizers.

       native frames             bytes from stdin; a line for each good frame, at the end the count of bad ones
       native control            lines from stdin: "m BODY" a message, "t N" ticks, "p N" pulses, each answered in a line
       native fuzz SEED BYTES    frames with random contents, damaged ones and noise, through all of it; stops with a
                                 failure where a pulse leaves its limits or the watchdog does not strike */

#include "control.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static struct frame_reader reader;
static struct control control;

static void print_message(const char *body)
{
    struct message message;
    uint8_t i;

    printf("%s", body);
    if (message_parse(body, &message)) {
        printf("\t%c", message.kind);
        for (i = 0; i < message.count; i++)
            printf(" %u", message.value[i]);
    }
    printf("\n");
}

static int frames(void)
{
    int byte;

    while ((byte = getchar()) != EOF) {
        if (frame_feed(&reader, (uint8_t)byte))
            print_message(reader.body);
    }
    printf("bad %u\n", reader.bad);
    return 0;
}

static void answer(const char *word, unsigned number)
{
    printf("%s %u now %u %u flags %u strikes %u accepted %u\n", word, number, control_now(&control, 0),
           control_now(&control, 1), control.flags, control.strikes, control.accepted);
}

static int talk(void)
{
    char line[256];

    control_start(&control, NULL);
    while (fgets(line, sizeof line, stdin)) {
        struct message message;
        uint16_t half_us[AXES] = {0, 0};
        unsigned i, n = (unsigned)atoi(line + 1);

        line[strcspn(line, "\n")] = 0;
        if (line[0] == 'm') {
            answer("answer", message_parse(line + 2, &message) ? control_message(&control, &message) : REFUSED_FIELDS);
        } else if (line[0] == 't') {
            unsigned struck = 0;

            for (i = 0; i < n; i++)
                struck += control_tick(&control);
            answer("struck", struck);
        } else {
            for (i = 0; i < n; i++)
                control_pulse(&control, half_us);
            printf("%u %u ", half_us[0], half_us[1]);
            answer("pulse", n);
        }
    }
    return 0;
}

static void fail(const char *what)
{
    fprintf(stderr, "%s\n", what);
    abort();
}

static unsigned drawn(unsigned below)
{
    static uint64_t state = 88172645463325252u;
    static int begun;

    if (!begun) {
        state ^= (uint64_t)rand() << 20;
        begun = 1;
    }
    state ^= state << 13;
    state ^= state >> 7;
    state ^= state << 17;
    return (unsigned)((state >> 16) % below);
}

/* Bytes of something that may come: noise, or a frame, as it should be or not. */
static size_t next_bytes(uint8_t *bytes)
{
    static const char kinds[] = "CCCCLLZIQ";
    struct frame_writer writer;
    size_t i, length, fields = drawn(7), more = 3 * drawn(2);

    if (drawn(4) == 0) {
        length = drawn(40);
        for (i = 0; i < length; i++)
            bytes[i] = (uint8_t)drawn(256);
        return length;
    }
    frame_begin(&writer, kinds[drawn(sizeof kinds - 1)]);
    if (drawn(2) == 0) { /* one that is meant, with pulses that are allowed, and others */
        frame_number(&writer, drawn(65536));
        frame_number(&writer, drawn(3) ? 8000 + drawn(14000) : drawn(2));
        frame_number(&writer, drawn(4) ? 8000 + drawn(7000) : drawn(15000));
        for (i = 0; i < more; i++)
            frame_number(&writer, drawn(4) ? 10000 + drawn(10000) : 15000 + drawn(50000));
    } else {
        for (i = 0; i < fields; i++)
            frame_number(&writer, drawn(3) ? drawn(70000) : drawn(2000000000));
    }
    length = frame_end(&writer);
    memcpy(bytes, writer.bytes, length);
    if (length && drawn(3) == 0)
        bytes[drawn((unsigned)length)] = (uint8_t)drawn(256);
    return drawn(10) ? length : length / 2;
}

static void check(const uint16_t half_us[AXES])
{
    uint8_t i;

    for (i = 0; i < AXES; i++) {
        const struct limits *limits = &control.axis[i].limits;

        if (limits->min < HARD_MIN || limits->max > HARD_MAX || limits->slew > HARD_SLEW || limits->slew == 0
            || limits->level < limits->min || limits->level > limits->max)
            fail("limits wider than the hard ones");
        if (5 * half_us[i] + 5 < limits->min || 5 * half_us[i] > limits->max + 5)
            fail("a pulse outside its limits");
    }
}

static int fuzz(unsigned long bytes)
{
    unsigned long done = 0, good = 0, obeyed = 0, strikes = 0;
    uint8_t some[FRAME_BYTES + 40], quiet = 0;
    uint16_t half_us[AXES];
    struct message message;

    control_start(&control, NULL);
    while (done < bytes) {
        size_t i, length = next_bytes(some);

        for (i = 0; i < length; i++, done++) {
            if (!frame_feed(&reader, some[i]))
                continue;
            good++;
            if (message_parse(reader.body, &message) && control_message(&control, &message) <= ANSWER_LIMITS) {
                obeyed++;
                if (message.kind == 'C')
                    quiet = 0;
            }
        }
        for (i = drawn(3) ? 0 : drawn(400) ? 1 : 50; i; i--) { /* now and then nobody speaks for long */
            strikes += control_tick(&control);
            if (!(control.flags & FLAG_LEVEL) && ++quiet > WATCHDOG_MS / TICK_MS)
                fail("the watchdog slept");
        }
        if (drawn(9) == 0) {
            control_pulse(&control, half_us);
            check(half_us);
        }
    }
    printf("bytes %lu good %lu obeyed %lu bad %u strikes %lu\n", done, good, obeyed, reader.bad, strikes);
    return 0;
}

int main(int count, char **arguments)
{
    if (count == 2 && strcmp(arguments[1], "frames") == 0)
        return frames();
    if (count == 2 && strcmp(arguments[1], "control") == 0)
        return talk();
    if (count == 4 && strcmp(arguments[1], "fuzz") == 0) {
        srand((unsigned)atoi(arguments[2]));
        return fuzz(strtoul(arguments[3], NULL, 10));
    }
    fprintf(stderr, "usage: %s frames|control|fuzz SEED BYTES\n", arguments[0]);
    return 2;
}
