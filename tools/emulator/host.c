/* Runs the firmware on a simulated ATmega2560, in real time, with its serial line on a pseudo terminal.

       emulator FIRMWARE.elf LINK

   LINK becomes a symbolic link to the terminal, so that its name stays the same when the board is unplugged and plugged
   in again. Orders come on stdin, one a line, and the program ends with stdin:

       adc V0 V1       volts at A0 and A1        noise V       their deviation in each conversion
       reset [MS]      pull the reset line, and let a boot loader swallow what comes until it heard nothing for so long
       stall           let the chip hang         errors P      lost and wrong bytes on the line, probability of each
       unplug          take the port away        plug          ... and give it back
       hold            no byte moves either way  release       ... until here
       fast 0|1        do not wait for the clock on the wall

   On stdout, one a line; T is in microseconds of the chip since its start:

       ready NAME      the terminal
       clock S T       T was at S seconds of the monotonic clock; said again where the machine was too slow to keep up
       pulse AXIS US T a pulse of this width ended at T: when the width changes, and twice a second
       silent AXIS T   no pulse for 50 ms
       reset T         the chip began anew */

#define _GNU_SOURCE
#include "machine.h"

#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

#define STEP_CYCLES (1000 * CYCLES_PER_US) /* how often the outside is looked at */
#define MOST_LATE_S 0.1                    /* caught up with afterwards; more is passed over */
#define FIRST -10 /* nice value: it takes a tenth of a core, but wants it in time */
#define AGAIN_S 0.5
#define SAME_US 0.4 /* pins change between instructions, up to .25 us late; a step of the timer is .5 */

static const char *link_name;
static int master = -1, slave = -1; /* the slave is kept open, so that a reader may come and go */
static bool held, fast;
static double zero;             /* seconds of the monotonic clock when T was 0 */
static double boot_s, boot_until; /* of the boot loader: how long it listens, and until when, 0 when it has ended */
static double last_width[2], last_said[2];

static double seconds(void)
{
    struct timespec now;

    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

static double chip_seconds(uint64_t cycles)
{
    return 1e-6 * (double)cycles / CYCLES_PER_US;
}

void on_pulse(int axis, double width_us, uint64_t when)
{
    double t = chip_seconds(when);

    if (fabs(width_us - last_width[axis]) < SAME_US && t < last_said[axis] + AGAIN_S)
        return;
    last_width[axis] = width_us;
    last_said[axis] = t;
    printf("pulse %d %.4f %.1f\n", axis, width_us, 1e6 * t);
}

void on_silence(int axis, uint64_t when)
{
    last_width[axis] = 0;
    printf("silent %d %.1f\n", axis, 1e6 * chip_seconds(when));
}

void on_reset(uint64_t when)
{
    printf("reset %.1f\n", 1e6 * chip_seconds(when));
}

static void say_clock(void)
{
    double t = chip_seconds(machine_now());

    zero = seconds() - t;
    printf("clock %.6f %.1f\n", zero + t, 1e6 * t);
}

static bool plug(void)
{
    char beside[4096];
    struct termios raw;

    master = posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
    if (master < 0 || grantpt(master) != 0 || unlockpt(master) != 0)
        return false;
    slave = open(ptsname(master), O_RDWR | O_NOCTTY | O_CLOEXEC);
    if (slave < 0 || tcgetattr(slave, &raw) != 0)
        return false;
    cfmakeraw(&raw);
    tcsetattr(slave, TCSANOW, &raw);
    snprintf(beside, sizeof beside, "%s.new", link_name);
    unlink(beside);
    return symlink(ptsname(master), beside) == 0 && rename(beside, link_name) == 0;
}

static void unplug(void)
{
    unlink(link_name);
    close(slave);
    close(master);
    master = slave = -1;
    machine_drop_fed();
}

static void obey(char *line)
{
    double a, b = 0;

    if (sscanf(line, "adc %lf %lf", &a, &b) == 2) {
        machine_volts(a, b);
    } else if (sscanf(line, "noise %lf", &a) == 1) {
        machine_noise(a);
    } else if (sscanf(line, "errors %lf", &a) == 1) {
        machine_line_errors(a);
    } else if (sscanf(line, "fast %lf", &a) == 1) {
        fast = a != 0;
        say_clock();
    } else if (strncmp(line, "reset", 5) == 0) {
        machine_drop_fed();
        machine_reset();
        boot_s = sscanf(line, "reset %lf", &a) == 1 ? 1e-3 * a : 0;
        boot_until = boot_s > 0 ? seconds() + boot_s : 0;
    } else if (strcmp(line, "stall") == 0) {
        machine_stall();
    } else if (strcmp(line, "hold") == 0) {
        held = true;
    } else if (strcmp(line, "release") == 0) {
        held = false;
    } else if (strcmp(line, "unplug") == 0) {
        if (master >= 0)
            unplug();
    } else if (strcmp(line, "plug") == 0) {
        if (master < 0 && !plug())
            perror(link_name);
    } else {
        fprintf(stderr, "unknown order: %s\n", line);
    }
}

/* False at the end of stdin. */
static bool read_orders(void)
{
    static char line[256];
    static size_t length;
    char bytes[512];
    ssize_t i, count = read(STDIN_FILENO, bytes, sizeof bytes);

    if (count <= 0)
        return count < 0 && (errno == EAGAIN || errno == EINTR);
    for (i = 0; i < count; i++) {
        if (bytes[i] != '\n') {
            if (length < sizeof line - 1)
                line[length++] = bytes[i];
            continue;
        }
        line[length] = 0;
        length = 0;
        obey(line);
    }
    return true;
}

static bool wants_bytes(void)
{
    return master >= 0 && !held && machine_room() > 0;
}

static void from_port(void)
{
    uint8_t bytes[1024];
    size_t room = machine_room();
    ssize_t count = read(master, bytes, room < sizeof bytes ? room : sizeof bytes);

    if (count > 0 && boot_until != 0)
        boot_until = seconds() + boot_s;
    else if (count > 0)
        machine_feed(bytes, (size_t)count);
}

/* What nobody reads is lost, as it is with a real port. */
static void to_port(void)
{
    uint8_t bytes[1024];
    size_t count = machine_take(bytes, sizeof bytes);

    if (count && master >= 0 && !held && write(master, bytes, count) < 0)
        return;
}

/* Look after stdin and port until this moment; false when it is all over. */
static bool wait_until(double moment)
{
    for (;;) {
        struct pollfd look[2] = {{STDIN_FILENO, POLLIN, 0}, {wants_bytes() ? master : -1, POLLIN, 0}};
        double left = fast ? 0 : moment - seconds();
        struct timespec most = {0, left > 0 ? (long)(1e9 * left) : 0};

        if (ppoll(look, 2, &most, NULL) < 0 && errno != EINTR)
            return false;
        if (look[0].revents && !read_orders())
            return false;
        if (look[1].revents & POLLIN)
            from_port();
        if (left <= 0)
            return true;
    }
}

/* One step of the chip, or of the boot loader before it runs. */
static bool step(void)
{
    if (boot_until == 0)
        return machine_run(machine_now() + STEP_CYCLES);
    if (seconds() >= boot_until) {
        boot_until = 0;
        say_clock();
    }
    return true;
}

int main(int count, char **arguments)
{
    if (count != 3) {
        fprintf(stderr, "usage: %s FIRMWARE.elf LINK\n", arguments[0]);
        return 2;
    }
    signal(SIGPIPE, SIG_IGN);
    if (setpriority(PRIO_PROCESS, 0, FIRST) != 0)
        errno = 0; /* not allowed: real time is then as good as the load of the machine lets it be */
    link_name = arguments[2];
    if (!machine_start(arguments[1]))
        return 2;
    if (!plug()) {
        perror(link_name);
        return 2;
    }
    fcntl(STDIN_FILENO, F_SETFL, O_NONBLOCK);
    printf("ready %s\n", ptsname(master));
    say_clock();
    for (;;) {
        double due;

        if (fflush(stdout) != 0)
            break;
        due = boot_until ? seconds() + 1e-3 : zero + chip_seconds(machine_now());
        if (!wait_until(due))
            break;
        if (!fast && !boot_until && seconds() > due + MOST_LATE_S)
            say_clock();
        if (!step())
            return 1;
        to_port();
    }
    unlink(link_name);
    return 0;
}
