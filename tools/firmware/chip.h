/* The parts of the ATmega2560 that the firmware uses; everything about registers is in chip.c. */

#ifndef MAZEPLAN_CHIP_H
#define MAZEPLAN_CHIP_H

#include "control.h"

#define CHANNELS 2
#define CHIP_RING 256           /* bytes received or to be sent; one less fits */
#define CONVERSIONS 16          /* of each channel in a sample of 5 ms */

/* The samples since they were last taken. */
struct samples {
    uint32_t sum[CHANNELS];     /* of conversions */
    uint8_t count;              /* samples of CONVERSIONS each */
    uint32_t first, last;       /* 0.1 ms since the start: middle of the first and of the last one */
};

/* Start everything. The three functions below are then called from interrupts. */
void chip_start(void);

/* Why the chip started last: bits of MCUSR (1 power on, 2 reset line, 4 brown-out, 8 watchdog). */
extern uint8_t chip_cause;

void on_tick(void);                        /* every 5 ms */
void on_pulse(uint16_t half_us[AXES]);     /* every 20 ms, before a pulse begins: how long it is to be */

bool chip_receive(uint8_t *byte);
uint8_t chip_room(void);                   /* bytes that can be sent at once */
void chip_send(const char *bytes, uint8_t length);

bool chip_samples(struct samples *taken, uint8_t at_least);
uint32_t chip_tenths(void);                /* 0.1 ms since the start */

/* Sleep until an interrupt, and keep the chip's own watchdog quiet as long as ticks come. */
void chip_rest(void);

void chip_lamp(bool on);

#endif
