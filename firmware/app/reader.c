/* Reads frames from bytes; skips other bytes.
 *
 * License: MIT. */
#include "app.h"

#include <string.h>

/* Takes bytes away from the front; what is left is looked at again from its first byte on. */
static void drop(esea_reader_t *reader, uint32_t count)
{
    reader->count -= count;
    memmove(reader->bytes, &reader->bytes[count], reader->count);
    reader->bad = reader->bad > count ? reader->bad - count : 0u;
    reader->next = 0u;
    reader->status.parse_state = MAVLINK_PARSE_STATE_IDLE;
}

void esea_reader_put(esea_reader_t *reader, uint8_t byte)
{
    if (reader->count == sizeof reader->bytes) /* never: no frame is longer */
        drop(reader, 1u);
    reader->bytes[reader->count++] = byte;
}

/* The next byte to the parser. */
static ESEA_READ step(esea_reader_t *reader)
{
    const uint8_t found = mavlink_frame_char_buffer(&reader->message, &reader->status,
            reader->bytes[reader->next++], NULL, NULL);
    const bool first = reader->bad == 0u;

    if (found == MAVLINK_FRAMING_OK) {
        drop(reader, reader->next);
        return ESEA_READ_FRAME;
    }
    if (found != MAVLINK_FRAMING_INCOMPLETE) {
        if (first) /* start bytes inside of a bad frame are no further bad ones */
            reader->bad = reader->next;
        drop(reader, 1u);
        return first ? ESEA_READ_BAD : ESEA_READ_NOTHING;
    }
    if (reader->status.parse_state <= MAVLINK_PARSE_STATE_IDLE)
        drop(reader, 1u);
    return ESEA_READ_NOTHING;
}

ESEA_READ esea_reader_next(esea_reader_t *reader)
{
    ESEA_READ found = ESEA_READ_NOTHING;

    while (found == ESEA_READ_NOTHING && reader->next < reader->count)
        found = step(reader);
    return found;
}

bool esea_reader_pauses(esea_reader_t *reader, uint32_t silence_ms)
{
    if (reader->count == 0u || silence_ms <= ESEA_FRAME_MS)
        return false;
    drop(reader, 1u);
    return true;
}
