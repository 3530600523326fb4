/* An ATmega2560 that runs the firmware in simavr, with what is wired to it: serial line, tilt diodes, servo pins.
   Times are in cycles of its 16 MHz clock since the start. */

#ifndef MAZEPLAN_MACHINE_H
#define MAZEPLAN_MACHINE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define CYCLES_PER_US 16

/* Load the firmware and start; false, with a line on stderr, where that cannot be. */
bool machine_start(const char *firmware);

/* Run until this cycle; false once the chip has crashed. */
bool machine_run(uint64_t until);

uint64_t machine_now(void);

/* Reset line of the chip. */
void machine_reset(void);

/* Let the chip hang for good, interrupts off: only its own watchdog can help. */
void machine_stall(void);

/* Room for bytes to the chip; give it bytes, which go over the line at 115200 baud. */
size_t machine_room(void);
void machine_feed(const uint8_t *bytes, size_t count);
void machine_drop_fed(void);

/* Take up to `most` bytes that the chip has sent. */
size_t machine_take(uint8_t *bytes, size_t most);

/* Voltages at A0 and A1, and the deviation of the noise that each conversion sees. */
void machine_volts(double first, double second);
void machine_noise(double volts);

/* Each byte on the line, in both directions, is lost or has one wrong bit with this probability. */
void machine_line_errors(double probability);

/* What happened on the pins, to be given by who uses this. */
void on_pulse(int axis, double width_us, uint64_t when);
void on_silence(int axis, uint64_t when);
void on_reset(uint64_t when);

#endif
