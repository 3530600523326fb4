#include "chip.h"

#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/sleep.h>
#include <avr/wdt.h>
#include <util/atomic.h>

/*  timer 1   servo pulses: fast PWM up to ICR1 (mode 14), 0.5 us a step, 20 ms; OC1A (PB5, pin 11) is beta, OC1B (PB6,
              pin 12) gamma. New widths are written at OCR1C, after all pulses have ended, and taken at the next period.
              OC1C (PB7, pin 13) is the board's lamp: lit while somebody commands
    timer 3   every 5 ms: watchdog of the control, and a burst of conversions
    ADC       channels 0 and 1 (A0, A1) in turns, 13 cycles of 125 kHz each: a burst takes 3.3 ms
    USART 0   115200 baud to within 2.1 %, rings of 256 bytes both ways */

#define PERIOD 40000UL          /* half microseconds */
#define WRITE_AT 38000U         /* half microseconds into the period: later than HARD_MAX, 1 ms before its end */
#define BAUD_DIVISOR 16         /* with U2X: 16 MHz / 8 / 17 */
#define TENTHS 50UL             /* of a ms in a tick */
#define BURST_MIDDLE 17U        /* 0.1 ms after the tick: half of 32 conversions of 104 us */

uint8_t chip_cause __attribute__((section(".noinit")));

static volatile uint8_t received[CHIP_RING], to_send[CHIP_RING];
static volatile uint8_t received_in, received_out, send_in, send_out; /* one byte: they wrap by themselves */

static volatile uint32_t ticks;
static uint8_t ticks_seen;
static volatile struct samples gathered;
static volatile uint8_t conversions;
static volatile uint16_t burst[CHANNELS];

/* Before anything else: after a reset by the watchdog it still runs, at its shortest time. */
void watchdog_off(void) __attribute__((naked, used, section(".init3")));
void watchdog_off(void)
{
    chip_cause = MCUSR;
    MCUSR = 0;
    wdt_disable();
}

static void start_servos(void)
{
    uint16_t half_us[AXES];

    on_pulse(half_us);
    ICR1 = PERIOD - 1;
    OCR1A = half_us[0] - 1; /* the pin is high for OCR1A + 1 steps */
    OCR1B = half_us[1] - 1;
    OCR1C = WRITE_AT;
    TIMSK1 = _BV(OCIE1C);
    DDRB |= _BV(PB5) | _BV(PB6) | _BV(PB7);
    TCCR1A = _BV(COM1A1) | _BV(COM1B1) | _BV(WGM11);
    TCCR1B = _BV(WGM13) | _BV(WGM12) | _BV(CS11);
}

void chip_start(void)
{
    start_servos();

    OCR3A = 9999; /* 5 ms of 0.5 us */
    TIMSK3 = _BV(OCIE3A);
    TCCR3B = _BV(WGM32) | _BV(CS31);

    ADMUX = _BV(REFS0); /* against the supply, as the sensor is */
    DIDR0 = _BV(ADC0D) | _BV(ADC1D);
    ADCSRA = _BV(ADEN) | _BV(ADIE) | _BV(ADPS2) | _BV(ADPS1) | _BV(ADPS0);

    UCSR0A = _BV(U2X0); /* before the divisor: simavr works out the time of a byte when that is written */
    UCSR0C = _BV(UCSZ01) | _BV(UCSZ00);
    UBRR0 = BAUD_DIVISOR;
    UCSR0B = _BV(RXEN0) | _BV(TXEN0) | _BV(RXCIE0);

    set_sleep_mode(SLEEP_MODE_IDLE);
    wdt_enable(WDTO_250MS);
    sei();
}

ISR(TIMER1_COMPC_vect)
{
    uint16_t half_us[AXES];

    on_pulse(half_us);
    OCR1A = half_us[0] - 1;
    OCR1B = half_us[1] - 1;
}

ISR(TIMER3_COMPA_vect)
{
    ticks++;
    on_tick();
    conversions = 0;
    burst[0] = burst[1] = 0;
    ADMUX = _BV(REFS0);
    ADCSRA |= _BV(ADSC);
}

ISR(ADC_vect)
{
    uint8_t channel = conversions & 1;

    burst[channel] += ADC;
    if (++conversions < CHANNELS * CONVERSIONS) {
        ADMUX = (uint8_t)(_BV(REFS0) | (channel ^ 1));
        ADCSRA |= _BV(ADSC);
        return;
    }
    if (gathered.count == UINT8_MAX)
        return; /* nobody takes them */
    gathered.last = ticks * TENTHS + BURST_MIDDLE;
    if (gathered.count++ == 0) {
        gathered.first = gathered.last;
        gathered.sum[0] = gathered.sum[1] = 0;
    }
    gathered.sum[0] += burst[0];
    gathered.sum[1] += burst[1];
}

bool chip_samples(struct samples *taken, uint8_t at_least)
{
    bool enough = false;

    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        if (gathered.count >= at_least) {
            taken->sum[0] = gathered.sum[0];
            taken->sum[1] = gathered.sum[1];
            taken->count = gathered.count;
            taken->first = gathered.first;
            taken->last = gathered.last;
            gathered.count = 0;
            enough = true;
        }
    }
    return enough;
}

uint32_t chip_tenths(void)
{
    uint32_t now = 0;

    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        now = ticks;
    }
    return now * TENTHS;
}

ISR(USART0_RX_vect)
{
    uint8_t broken = UCSR0A & (_BV(FE0) | _BV(DOR0) | _BV(UPE0)), byte = UDR0;

    if ((uint8_t)(received_in + 1) == received_out)
        return; /* full: the frame's sum will tell */
    received[received_in++] = broken ? 0 : byte; /* 0 is in no frame */
}

ISR(USART0_UDRE_vect)
{
    if (send_out == send_in)
        UCSR0B &= (uint8_t)~_BV(UDRIE0);
    else
        UDR0 = to_send[send_out++];
}

bool chip_receive(uint8_t *byte)
{
    if (received_out == received_in)
        return false;
    *byte = received[received_out++];
    return true;
}

uint8_t chip_room(void)
{
    return (uint8_t)(send_out - send_in - 1);
}

void chip_send(const char *bytes, uint8_t length)
{
    uint8_t at = send_in;

    if (length > chip_room())
        return;
    while (length--)
        to_send[at++] = (uint8_t)*bytes++;
    send_in = at;
    UCSR0B |= _BV(UDRIE0);
}

void chip_rest(void)
{
    uint8_t now = (uint8_t)ticks;

    if (now != ticks_seen) { /* with no ticks there is no control: better a fresh start */
        ticks_seen = now;
        wdt_reset();
    }
    cli();
    if (received_out == received_in) {
        sleep_enable();
        sei();
        sleep_cpu();
        sleep_disable();
    }
    sei();
}

void chip_lamp(bool on)
{
    if (on) /* by the timer, 95 % of the time; simavr takes servo pins down when their port is written */
        TCCR1A |= _BV(COM1C1);
    else
        TCCR1A &= (uint8_t)~_BV(COM1C1);
}
