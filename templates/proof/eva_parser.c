/* What the value analysis is asked of the parser of the link, in three parts.
 *
 * ESEA_EVA_FRAME: a byte, in every state of the parser, with any bits in all its memory, as far as the two
 * assertions hold that it keeps itself: so any bytes in any number.  Then the decoders of the device's binding,
 * on any bits in the message.  Signatures by their contract.
 * ESEA_EVA_SIGNATURE: the check of a signature, for every length of a message; the sum's compression by its
 * contract.
 * ESEA_EVA_SUM: the compression, from any bits.
 *
 * License: MIT. */
#include "__fc_builtin.h"

#include ESEA_LINK_HEADER

#define ANY(x) Frama_C_make_unknown((char *)&(x), sizeof(x))

static mavlink_message_t received;
static mavlink_status_t receiving;
static mavlink_signing_t key;
static mavlink_signing_streams_t streams;

static void any_memory(mavlink_signing_t *signing)
{
    const unsigned count = Frama_C_unsigned_int_interval(0u, MAVLINK_MAX_SIGNING_STREAMS); /* kept: streams_fit */

    ANY(received);
    ANY(receiving);
    ANY(key);
    ANY(streams);
    streams.num_signing_streams = (uint16_t)count;
    key.accept_unsigned_callback = NULL; /* assumed: as signing.c leaves it */
    receiving.signing = signing;
    receiving.signing_streams = &streams; /* assumed: as signing.c sets it; not looked at without a key */
}

#ifdef ESEA_EVA_FRAME
static void take(unsigned state)
{
    receiving.parse_state = (mavlink_parse_state_t)state;
    (void)mavlink_frame_char_buffer(
            &received, &receiving, (uint8_t)Frama_C_unsigned_int_interval(0u, 255u), NULL, NULL);
    /*@ assert signature_fits: receiving.parse_state == MAVLINK_PARSE_STATE_SIGNATURE_WAIT ||
            receiving.parse_state == MAVLINK_PARSE_STATE_SIGNATURE_WAIT_BAD_CRC ==>
            1 <= receiving.signature_wait <= MAVLINK_SIGNATURE_BLOCK_LEN; */
    /*@ assert streams_fit: streams.num_signing_streams <= MAVLINK_MAX_SIGNING_STREAMS; */
}

static void decode(void)
{
    esea_link_in_t in;
    esea_link_wanted_t wanted;
    uint32_t task, sequence, deadline_ms;

    ANY(received);
    (void)esea_link_decode(&received, &task, &sequence, &in);
    (void)esea_link_decode_wanted(&received, &wanted, &deadline_ms);
}

/* A byte in a state of the parser; where that is needed, for each value of what it counts. */
static void bytes_in(unsigned state, mavlink_signing_t *signing)
{
    unsigned n;

    switch (state) {
    case MAVLINK_PARSE_STATE_GOT_PAYLOAD:
        /*@ loop unroll 256; */
        for (n = 0u; n < 256u; ++n) {
            any_memory(signing);
            receiving.packet_idx = (uint8_t)n;
            take(state);
        }
        break;
    case MAVLINK_PARSE_STATE_GOT_CRC1:
    case MAVLINK_PARSE_STATE_GOT_BAD_CRC1:
        /*@ loop unroll 256; */
        for (n = 0u; n < 256u; ++n) {
            any_memory(signing);
            received.incompat_flags = (uint8_t)n;
            take(state);
        }
        break;
    case MAVLINK_PARSE_STATE_SIGNATURE_WAIT:
    case MAVLINK_PARSE_STATE_SIGNATURE_WAIT_BAD_CRC:
        /*@ loop unroll 13; */
        for (n = 1u; n <= MAVLINK_SIGNATURE_BLOCK_LEN; ++n) { /* kept: signature_fits */
            any_memory(signing);
            receiving.signature_wait = (uint8_t)n;
            take(state);
        }
        break;
    default:
        any_memory(signing);
        take(state);
        break;
    }
}

int main(void)
{
    unsigned state;

    /*@ loop unroll 18; */
    for (state = 0u; state <= MAVLINK_PARSE_STATE_SIGNATURE_WAIT_BAD_CRC + 1u; ++state) {
        bytes_in(state, NULL);
        bytes_in(state, &key);
    }
    decode();
    return 0;
}
#elif defined(ESEA_EVA_SIGNATURE)
int main(void)
{
    unsigned n;

    any_memory(NULL);
    (void)mavlink_signature_check(NULL, &streams, &received);
    /*@ loop unroll 256; */
    for (n = 0u; n < 256u; ++n) {
        any_memory(&key);
        received.len = (uint8_t)n;
        (void)mavlink_signature_check(&key, &streams, &received);
        /*@ assert streams_fit: streams.num_signing_streams <= MAVLINK_MAX_SIGNING_STREAMS; */
    }
    return 0;
}
#else
int main(void)
{
    mavlink_sha256_ctx sum;

    ANY(sum);
    mavlink_sha256_calc(&sum);
    return 0;
}
#endif
