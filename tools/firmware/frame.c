#include "frame.h"

#define TOO_LONG 255

uint16_t frame_crc(uint16_t crc, uint8_t byte)
{
    uint8_t bit;

    crc ^= (uint16_t)((uint16_t)byte << 8);
    for (bit = 0; bit < 8; bit++)
        crc = (uint16_t)(crc & 0x8000 ? (uint16_t)(crc << 1) ^ 0x1021 : crc << 1);
    return crc;
}

static int8_t hexadecimal(uint8_t byte)
{
    if (byte >= '0' && byte <= '9')
        return (int8_t)(byte - '0');
    if (byte >= 'A' && byte <= 'F')
        return (int8_t)(byte - 'A' + 10);
    return -1;
}

static void open_frame(struct frame_reader *reader)
{
    reader->state = FRAME_BODY_NEXT;
    reader->length = 0;
    reader->crc = 0xFFFF;
}

static void give_up(struct frame_reader *reader)
{
    reader->state = FRAME_OUTSIDE;
    reader->bad++;
}

static void body_byte(struct frame_reader *reader, uint8_t byte)
{
    if (byte == '*') {
        reader->body[reader->length] = 0;
        reader->state = FRAME_SUM_NEXT;
        reader->digits = 0;
        reader->sum = 0;
    } else if (byte < ' ' || byte > '~' || reader->length == FRAME_BODY) {
        give_up(reader);
    } else {
        reader->body[reader->length++] = (char)byte;
        reader->crc = frame_crc(reader->crc, byte);
    }
}

static void sum_byte(struct frame_reader *reader, uint8_t byte)
{
    int8_t digit = hexadecimal(byte);

    if (digit < 0) {
        give_up(reader);
        return;
    }
    reader->sum = (uint16_t)(reader->sum << 4 | digit);
    if (++reader->digits == 4)
        reader->state = FRAME_NEWLINE_NEXT;
}

bool frame_feed(struct frame_reader *reader, uint8_t byte)
{
    if (byte == '$') { /* wherever it comes: a frame begins; the one that was under way was cut off */
        if (reader->state != FRAME_OUTSIDE)
            reader->bad++;
        open_frame(reader);
    } else if (reader->state == FRAME_BODY_NEXT) {
        body_byte(reader, byte);
    } else if (reader->state == FRAME_SUM_NEXT) {
        sum_byte(reader, byte);
    } else if (reader->state == FRAME_NEWLINE_NEXT) {
        if (byte != '\n' || reader->sum != reader->crc) {
            give_up(reader);
            return false;
        }
        reader->state = FRAME_OUTSIDE;
        return true;
    }
    return false;
}

bool message_parse(const char *body, struct message *message)
{
    if (*body < 'A' || *body > 'Z')
        return false;
    message->kind = *body++;
    message->count = 0;
    while (*body == ',') {
        uint32_t number = 0;
        uint8_t digits = 0;

        for (body++; *body >= '0' && *body <= '9' && digits < 6; body++, digits++)
            number = 10 * number + (uint32_t)(*body - '0');
        if (digits == 0 || number > UINT16_MAX || message->count == MESSAGE_VALUES)
            return false;
        message->value[message->count++] = (uint16_t)number;
    }
    return *body == 0 && message->count > 0;
}

static void put(struct frame_writer *writer, char byte)
{
    if (writer->length > FRAME_BODY) { /* '$' and the body; there must be room for the sum */
        writer->length = TOO_LONG;
        return;
    }
    writer->bytes[writer->length++] = byte;
    writer->crc = frame_crc(writer->crc, (uint8_t)byte);
}

void frame_begin(struct frame_writer *writer, char kind)
{
    writer->bytes[0] = '$';
    writer->length = 1;
    writer->crc = 0xFFFF;
    put(writer, kind);
}

void frame_text(struct frame_writer *writer, const char *text)
{
    put(writer, ',');
    while (*text)
        put(writer, *text++);
}

void frame_number(struct frame_writer *writer, uint32_t number)
{
    char digits[11];
    uint8_t at = sizeof digits - 1;
    uint16_t few;

    digits[at] = 0;
    for (; number > UINT16_MAX; number /= 10)
        digits[--at] = (char)('0' + number % 10);
    few = (uint16_t)number; /* dividing 16 bits takes a third of the time */
    do {
        digits[--at] = (char)('0' + few % 10);
        few /= 10;
    } while (few);
    frame_text(writer, digits + at);
}

uint8_t frame_end(struct frame_writer *writer)
{
    static const char hex[] = "0123456789ABCDEF";
    uint8_t shift = 16;

    if (writer->length == TOO_LONG)
        return 0;
    writer->bytes[writer->length++] = '*';
    while (shift) {
        shift = (uint8_t)(shift - 4);
        writer->bytes[writer->length++] = hex[writer->crc >> shift & 15];
    }
    writer->bytes[writer->length++] = '\n';
    return writer->length;
}
