#include "machine.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <simavr/sim_avr.h>
#include <simavr/avr_adc.h>
#include <simavr/avr_ioport.h>
#include <simavr/avr_uart.h>
#include <simavr/sim_elf.h>
#include <simavr/sim_time.h>

#define CLOCK_HZ 16000000
#define BYTE_CYCLES (CLOCK_HZ / 11520) /* 10 bits at 115200 baud */
#define LINE 4096
#define SUPPLY_MV 5000
#define LOST_AFTER (50000 * CYCLES_PER_US) /* a servo sees two pulses missing */
#define JUMP_TO_ITSELF 0xCFFF              /* rjmp .-2 */
#define OCR1AL 0x88                        /* low bytes of the pulses' widths: B follows A, high follows low */

struct ring {
    uint8_t bytes[LINE];
    size_t in, out; /* never taken modulo LINE */
};

static avr_t *avr;
static struct ring to_chip, from_chip;
static bool room_in_uart = true;
static avr_irq_t *uart_input, *adc_input[2];
static double volts[2], noise, line_errors;
static uint64_t drawn = 88172645463325252u;
static uint64_t rose[2], seen[2];
static bool alive[2];
static void (*chip_reset)(avr_t *);
static bool stalled;
static avr_flashaddr_t stalled_at;
static uint8_t stalled_code[2];
static avr_io_write_t write_width[2]; /* simavr's own */
static uint16_t width[2];

static double uniform(void)
{
    drawn ^= drawn << 13;
    drawn ^= drawn >> 7;
    drawn ^= drawn << 17;
    return (double)(drawn >> 11) / 9007199254740992.0;
}

/* Nearly normal, with deviation 1. */
static double normal(void)
{
    double sum = -6;
    int i;

    for (i = 0; i < 12; i++)
        sum += uniform();
    return sum;
}

/* What arrives of a byte: -1 where it is lost. */
static int over_the_line(uint8_t byte)
{
    if (line_errors == 0 || uniform() >= line_errors)
        return byte;
    return uniform() < 0.5 ? -1 : byte ^ 1 << (int)(8 * uniform());
}

static avr_cycle_count_t feed_one(avr_t *chip, avr_cycle_count_t when, void *unused)
{
    (void)chip, (void)unused;
    if (to_chip.in != to_chip.out && room_in_uart) {
        int byte = over_the_line(to_chip.bytes[to_chip.out++ % LINE]);

        if (byte >= 0)
            avr_raise_irq(uart_input, (uint32_t)byte);
    }
    return when + BYTE_CYCLES;
}

static void byte_sent(avr_irq_t *irq, uint32_t value, void *unused)
{
    int byte = over_the_line((uint8_t)value);

    (void)irq, (void)unused;
    if (byte >= 0 && from_chip.in - from_chip.out < LINE)
        from_chip.bytes[from_chip.in++ % LINE] = (uint8_t)byte;
}

static void uart_has_room(avr_irq_t *irq, uint32_t value, void *room)
{
    (void)irq;
    if (value)
        room_in_uart = room != NULL;
}

/* A conversion begins: the voltage of this moment, in whole millivolts as simavr has it. */
static void conversion(avr_irq_t *irq, uint32_t value, void *unused)
{
    int i;

    (void)irq, (void)value, (void)unused;
    for (i = 0; i < 2; i++) {
        double mv = floor(1000 * (volts[i] + noise * normal()) + uniform());

        avr_raise_irq(adc_input[i], mv < 0 ? 0 : mv > SUPPLY_MV ? SUPPLY_MV : (uint32_t)mv);
    }
}

static void pin_changed(avr_irq_t *irq, uint32_t value, void *which)
{
    int axis = (int)(intptr_t)which;

    (void)irq;
    if (value) {
        rose[axis] = avr->cycle;
    } else if (rose[axis]) {
        alive[axis] = true;
        seen[axis] = avr->cycle;
        on_pulse(axis, (double)(avr->cycle - rose[axis]) / CYCLES_PER_US, avr->cycle);
        rose[axis] = 0;
    }
}

/* simavr looks for a change when the low byte comes, with the high byte there already: where only that is another one
   it sees none, and goes on with the old width. So it is shown another low byte first. */
static void width_written(avr_t *chip, avr_io_addr_t address, uint8_t low, void *param)
{
    int axis = (address - OCR1AL) / 2;
    uint16_t now = (uint16_t)(chip->data[address + 1] << 8 | low);

    if (now != width[axis] && (uint8_t)width[axis] == low)
        write_width[axis](chip, address, low ^ 1, param);
    write_width[axis](chip, address, low, param);
    width[axis] = now;
}

static void after_reset(avr_t *chip)
{
    if (stalled) {
        memcpy(avr->flash + stalled_at, stalled_code, sizeof stalled_code);
        stalled = false;
    }
    if (chip_reset)
        chip_reset(chip);
    rose[0] = rose[1] = 0;
    width[0] = width[1] = 0; /* its memory is cleared */
    room_in_uart = true;
    avr_cycle_timer_register(avr, BYTE_CYCLES, feed_one, NULL); /* a reset takes all timers away */
    on_reset(avr->cycle);
}

static void no_sleep(avr_t *chip, avr_cycle_count_t cycles)
{
    (void)chip, (void)cycles; /* who calls machine_run keeps the time */
}

static void quiet_log(avr_t *chip, const int level, const char *format, va_list arguments)
{
    (void)chip;
    if (level <= LOG_ERROR)
        vfprintf(stderr, format, arguments);
}

static void wire(void)
{
    uint32_t flags = 0;
    int i;

    avr_ioctl(avr, AVR_IOCTL_UART_SET_FLAGS('0'), &flags);
    uart_input = avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_INPUT);
    avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUTPUT), byte_sent, NULL);
    avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUT_XON), uart_has_room, avr);
    avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUT_XOFF), uart_has_room, NULL);
    avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_ADC_GETIRQ, ADC_IRQ_OUT_TRIGGER), conversion, NULL);
    for (i = 0; i < 2; i++) {
        adc_input[i] = avr_io_getirq(avr, AVR_IOCTL_ADC_GETIRQ, ADC_IRQ_ADC0 + i);
        avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ('B'), 5 + i), pin_changed,
                                (void *)(intptr_t)i);
        write_width[i] = avr->io[AVR_DATA_TO_IO(OCR1AL + 2 * i)].w.c;
        avr->io[AVR_DATA_TO_IO(OCR1AL + 2 * i)].w.c = width_written;
    }
}

bool machine_start(const char *firmware)
{
    elf_firmware_t elf;

    avr_global_logger_set(quiet_log);
    memset(&elf, 0, sizeof elf);
    if (elf_read_firmware(firmware, &elf) != 0 || elf.flashsize == 0) {
        fprintf(stderr, "%s: no firmware for an ATmega2560\n", firmware);
        return false;
    }
    avr = avr_make_mcu_by_name("atmega2560");
    if (!avr) {
        fprintf(stderr, "this simavr has no ATmega2560\n");
        return false;
    }
    avr_init(avr);
    avr_load_firmware(avr, &elf);
    avr->frequency = CLOCK_HZ;
    avr->vcc = avr->avcc = avr->aref = SUPPLY_MV;
    avr->sleep = no_sleep;
    wire();
    chip_reset = avr->reset;
    avr->reset = after_reset;
    avr_cycle_timer_register(avr, BYTE_CYCLES, feed_one, NULL);
    return true;
}

bool machine_run(uint64_t until)
{
    int axis;

    while (avr->cycle < until) {
        int state = avr_run(avr);

        if (state == cpu_Done || state == cpu_Crashed) {
            fprintf(stderr, "the chip crashed at %.6f s\n", (double)avr->cycle / CLOCK_HZ);
            return false;
        }
    }
    for (axis = 0; axis < 2; axis++) {
        if (alive[axis] && avr->cycle - seen[axis] > LOST_AFTER) {
            alive[axis] = false;
            on_silence(axis, avr->cycle);
        }
    }
    return true;
}

uint64_t machine_now(void)
{
    return avr->cycle;
}

void machine_reset(void)
{
    avr_reset(avr);
    avr_regbit_set(avr, avr->reset_flags.extrf);
}

void machine_stall(void)
{
    stalled_at = avr->pc;
    memcpy(stalled_code, avr->flash + stalled_at, sizeof stalled_code);
    avr->flash[stalled_at] = JUMP_TO_ITSELF & 0xFF;
    avr->flash[stalled_at + 1] = JUMP_TO_ITSELF >> 8;
    avr->sreg[S_I] = 0;
    avr->state = cpu_Running;
    stalled = true;
}

size_t machine_room(void)
{
    return LINE - (to_chip.in - to_chip.out);
}

void machine_feed(const uint8_t *bytes, size_t count)
{
    while (count-- && machine_room())
        to_chip.bytes[to_chip.in++ % LINE] = *bytes++;
}

void machine_drop_fed(void)
{
    to_chip.out = to_chip.in;
}

size_t machine_take(uint8_t *bytes, size_t most)
{
    size_t count = 0;

    while (count < most && from_chip.out != from_chip.in)
        bytes[count++] = from_chip.bytes[from_chip.out++ % LINE];
    return count;
}

void machine_volts(double first, double second)
{
    volts[0] = first;
    volts[1] = second;
}

void machine_noise(double deviation)
{
    noise = deviation;
}

void machine_line_errors(double probability)
{
    line_errors = probability;
}
