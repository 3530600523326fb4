/* Frames of the line protocol (docs/protocol.md), pure C: the same file runs on the chip and in the tests.

       $T,17,123450,32768,32760,15000,15000,0,0,0*B6DC\n

   '$', a body of printable characters, '*', the CRC-16 of the body as four upper-case hexadecimal digits, newline. */

#ifndef MAZEPLAN_FRAME_H
#define MAZEPLAN_FRAME_H

#include <stdbool.h>
#include <stdint.h>

#define FRAME_BODY 64                  /* characters of a body at most */
#define FRAME_BYTES (FRAME_BODY + 7)   /* of a whole frame: $ * CRC newline */
#define MESSAGE_VALUES 6               /* numbers behind the letter at most */

enum frame_state { FRAME_OUTSIDE, FRAME_BODY_NEXT, FRAME_SUM_NEXT, FRAME_NEWLINE_NEXT };

/* What has come of a frame so far. All zero is a good start. */
struct frame_reader {
    uint8_t state, length, digits;
    uint16_t crc, sum;
    uint16_t bad;                      /* frames given up since the start, modulo 65536 */
    char body[FRAME_BODY + 1];         /* ends with 0 once a frame is complete */
};

/* A frame that is being written. */
struct frame_writer {
    uint8_t length;
    uint16_t crc;
    char bytes[FRAME_BYTES];
};

/* What the host says: a letter and numbers, the first of which is the sequence number. */
struct message {
    char kind;
    uint8_t count;
    uint16_t value[MESSAGE_VALUES];
};

/* CRC-16 with polynomial 0x1021, begun with 0xFFFF, one byte further. */
uint16_t frame_crc(uint16_t crc, uint8_t byte);

/* Take one byte; true when it completes a frame whose sum is right: `body` is then valid until the next byte. */
bool frame_feed(struct frame_reader *reader, uint8_t byte);

/* The body as a message; false if it is none. */
bool message_parse(const char *body, struct message *message);

/* Write a frame: begin, any number of fields, end. What does not fit is left out, and end() returns 0. */
void frame_begin(struct frame_writer *writer, char kind);
void frame_number(struct frame_writer *writer, uint32_t number);
void frame_text(struct frame_writer *writer, const char *text);
uint8_t frame_end(struct frame_writer *writer);

#endif
