/* libFuzzer on what stands between the line and the application: the reader over MAVLink's parser, and the
 * decoders of the device's binding.  Bytes, whole frames of every message, frames with bits turned, cut off or
 * with something before them, to a board that is paired and one that is not.  Whatever is taken is a frame that
 * stood in the bytes with the checksum that X.25 says, computed here bit by bit; when paired, one signed with the
 * key and with a later time than all of its sender before.  (Who signed it is not asked: libFuzzer sees what a
 * signature is compared with, and forges one.)
 *
 * License: MIT. */
#include "app.h"

#include <stdlib.h>

#define LONGEST 4096u

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static const mavlink_msg_entry_t entries[] = MAVLINK_MESSAGE_CRCS;
static const uint8_t *bytes;
static size_t left;
static uint8_t line[LONGEST];
static size_t count; /* of all that was on the line */
static esea_reader_t reader;
static bool paired;
static mavlink_signing_t key;
static mavlink_signing_streams_t streams;

static struct {
    uint8_t sender[3]; /* system, component, link */
    uint64_t time;     /* of the last frame that was taken */
} senders[MAVLINK_MAX_SIGNING_STREAMS];
static size_t known; /* senders */

static void must(bool holds)
{
    if (!holds)
        abort();
}

static uint8_t next(void)
{
    return left > 0u ? (--left, *bytes++) : 0u;
}

/* Its branches tell the fuzzer nothing. */
__attribute__((no_sanitize("coverage"))) static uint32_t crc_of(const uint8_t *from, size_t n, uint8_t extra)
{
    uint32_t crc = 0xFFFFu;
    size_t i;
    int bit;

    for (i = 0u; i <= n; ++i)
        for (crc ^= i < n ? from[i] : extra, bit = 0; bit < 8; ++bit)
            crc = crc >> 1 ^ ((crc & 1u) != 0u ? 0x8408u : 0u);
    return crc;
}

/* The frame that has just ended stands on the line, whole. */
static void check_frame(void)
{
    const bool old = reader.message.magic == MAVLINK_STX_MAVLINK1;
    const bool is_signed = (reader.message.incompat_flags & MAVLINK_IFLAG_SIGNED) != 0u;
    const size_t head = old ? 6u : 10u, tail = is_signed ? 13u : 0u;
    const size_t length = head + reader.message.len + 2u + tail;
    const uint8_t *const frame = line + count - reader.count - length;
    const mavlink_msg_entry_t *entry = NULL;
    uint32_t i, id, crc;

    must(length <= count - reader.count && frame[0] == (old ? 0xFEu : 0xFDu) && frame[1] == reader.message.len);
    id = old ? frame[5] : frame[7] | (uint32_t)frame[8] << 8 | (uint32_t)frame[9] << 16;
    for (i = 0u; i < sizeof entries / sizeof entries[0]; ++i)
        if (entries[i].msgid == id)
            entry = &entries[i];
    must(entry != NULL && id == reader.message.msgid);
    must(memcmp(_MAV_PAYLOAD(&reader.message), frame + head, reader.message.len) == 0);
    for (i = reader.message.len; i < entry->max_msg_len; ++i) /* nothing is left of the frame before */
        must(_MAV_PAYLOAD(&reader.message)[i] == 0);
    crc = crc_of(frame + 1, head - 1u + reader.message.len, entry->crc_extra);
    must(frame[length - tail - 2u] == (crc & 0xFFu) && frame[length - tail - 1u] == crc >> 8);
}

/* MAVLink's signature: of the key, the frame, the link's number and a time, six bytes of SHA-256. */
static void signature_of(const uint8_t *frame, size_t length, uint8_t *signature)
{
    mavlink_sha256_ctx hash;

    mavlink_sha256_init(&hash);
    mavlink_sha256_update(&hash, key.secret_key, sizeof key.secret_key);
    mavlink_sha256_update(&hash, frame, (uint32_t)length - 6u);
    mavlink_sha256_final_48(&hash, signature);
}

/* The frame that has just been taken was signed with the key, and is not an old one again. */
static void check_signed(void)
{
    const size_t length = 10u + reader.message.len + 2u + MAVLINK_SIGNATURE_BLOCK_LEN;
    const uint8_t *const frame = line + count - reader.count - length;
    const uint8_t *const block = frame + length - MAVLINK_SIGNATURE_BLOCK_LEN;
    const uint8_t sender[3] = {frame[5], frame[6], block[0]};
    uint8_t signature[6], i;
    uint64_t time = 0u;
    size_t at;

    must((reader.message.incompat_flags & MAVLINK_IFLAG_SIGNED) != 0u);
    signature_of(frame, length, signature);
    must(memcmp(block + 7, signature, sizeof signature) == 0);
    for (i = 6u; i > 0u; --i)
        time = time << 8 | block[i];
    for (at = 0u; at < known && memcmp(senders[at].sender, sender, sizeof sender) != 0; ++at)
        ;
    if (at == known) {
        must(known < MAVLINK_MAX_SIGNING_STREAMS);
        memcpy(senders[known++].sender, sender, sizeof sender);
    } else {
        must(time > senders[at].time);
    }
    senders[at].time = time;
}

/* What the application's decoders make of it; addresses and lengths are the sanitizers' to look at. */
static void decode(void)
{
    esea_link_in_t in;
    esea_link_wanted_t wanted;
    uint32_t task, sequence, deadline_ms, boot, time_ms;
    const bool is_input = esea_link_decode(&reader.message, &task, &sequence, &in);
    const bool is_wanted = esea_link_decode_wanted(&reader.message, &wanted, &deadline_ms, &boot, &time_ms);

    must(!(is_input && is_wanted));
    must(!is_input || (task < ESEA_LINK_TASKS && reader.message.msgid == esea_link_message(task, 0u)));
    must(!is_wanted || (reader.message.msgid == MAVLINK_MSG_ID_ESEA_WANTED && deadline_ms <= UINT16_MAX));
}

static bool good(void)
{
#ifdef BLIND
    return true;
#else
    return (reader.message.incompat_flags & MAVLINK_IFLAG_SIGNED) != 0u &&
           mavlink_signature_check(&key, &streams, &reader.message);
#endif
}

static void take_frames(void)
{
    ESEA_READ found;

    while ((found = esea_reader_next(&reader)) != ESEA_READ_NOTHING)
        if (found == ESEA_READ_FRAME) {
            check_frame(); /* a stop in it is taken, whoever signed it */
            if (paired && good())
                check_signed();
            decode();
        }
}

static void receive(uint8_t byte)
{
    if (count == LONGEST)
        return;
    line[count++] = byte;
    esea_reader_put(&reader, byte);
    take_frames();
}

static void sign(uint8_t *frame, uint16_t length)
{
    uint8_t *const block = frame + length - MAVLINK_SIGNATURE_BLOCK_LEN;
    uint8_t i;

    memset(block, 0, MAVLINK_SIGNATURE_BLOCK_LEN);
    if (!paired)
        return;
    block[1] = (uint8_t)(1u + next() / 2u);
    signature_of(frame, length, block + 7);
    for (i = 0u; i < 4u && next() > 250u; ++i)
        block[next() % MAVLINK_SIGNATURE_BLOCK_LEN] ^= next();
}

/* A frame of any message and length: signed, or MAVLink 1, or neither. */
static uint16_t write_frame(uint8_t *frame, bool is_signed, bool old)
{
    const mavlink_msg_entry_t *const entry = &entries[next() % (sizeof entries / sizeof entries[0])];
    const uint16_t head = old && entry->msgid < 256u ? 6u : 10u;
    const uint8_t payload = next() % (entry->max_msg_len + 2u);
    const bool ends_signed = is_signed && head == 10u;
    uint32_t crc;
    uint16_t i;

    memset(frame, 0, 10u);
    frame[0] = head == 6u ? MAVLINK_STX_MAVLINK1 : MAVLINK_STX;
    frame[1] = payload;
    frame[2] = ends_signed ? MAVLINK_IFLAG_SIGNED : 0u;
    frame[head == 6u ? 3 : 5] = 255u; /* the sender */
    frame[head == 6u ? 5 : 7] = (uint8_t)entry->msgid;
    if (head == 10u) {
        frame[8] = (uint8_t)(entry->msgid >> 8);
        frame[9] = (uint8_t)(entry->msgid >> 16);
    }
    for (i = 0u; i < payload; ++i)
        frame[head + i] = next();
    crc = crc_of(frame + 1, head - 1u + payload, entry->crc_extra);
    frame[head + payload] = (uint8_t)crc;
    frame[head + payload + 1] = (uint8_t)(crc >> 8);
    if (!ends_signed)
        return head + payload + 2u;
    sign(frame, head + payload + 2u + MAVLINK_SIGNATURE_BLOCK_LEN);
    return head + payload + 2u + MAVLINK_SIGNATURE_BLOCK_LEN;
}

static void send_frame(uint8_t kind)
{
    uint8_t frame[MAVLINK_MAX_PACKET_LEN];
    uint16_t length = write_frame(frame, (kind & 1u) != 0u, (kind & 2u) != 0u), i;

    for (i = 0u; i < (kind >> 2) % 4u; ++i)
        frame[next() % length] ^= (uint8_t)(1u << next() % 8u);
    if ((kind >> 4) == 0u)
        length = (uint16_t)(length - next() % length);
    for (i = 0u; i < length; ++i)
        receive(frame[i]);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    uint8_t op, i;

    bytes = data;
    left = size;
    count = 0u;
    memset(&reader, 0, sizeof reader);
    memset(&key, 0, sizeof key);
    memset(senders, 0, sizeof senders);
    known = 0u;
    streams.num_signing_streams = 0u;
    memset(&reader.message, 0x5A, sizeof reader.message); /* of an earlier frame */
    paired = next() % 4u == 0u;
    while (left > 0u) {
        op = next();
        if (op < 64u)
            for (i = 0u; i <= op % 16u; ++i)
                receive(next());
        else
            send_frame((uint8_t)(op - 64u));
        if (op == 255u)
            while (esea_reader_pauses(&reader, UINT32_MAX))
                take_frames();
    }
    return 0;
}
