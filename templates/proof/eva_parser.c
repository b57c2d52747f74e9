/* What the value analysis is asked of the way from bytes to a frame whose sender may command, in four parts.
 *
 * ESEA_EVA_FRAME: a byte, in every state of MAVLink's parser, with any bits in all its memory, as far as the assertion
 * holds that it keeps itself: so any bytes in any number.  Then the decoders of the device's binding, on any bits in
 * the message.
 * ESEA_EVA_READER: reader.c, for every place at which the parser may be in the bytes that wait, and every answer of
 * the parser.
 * ESEA_EVA_SIGNATURE: MAVLink's check of a signature and what signing.c makes of it, for every length of a message;
 * the sum's compression by its contract.
 * ESEA_EVA_SUM: the compression, from any bits.
 *
 * License: MIT. */
#include "__fc_builtin.h"

#if defined(ESEA_EVA_SIGNATURE)
#include "signing.c"
#elif defined(ESEA_EVA_READER)
#include "app.h"

/* The parser: any message and memory, its answer as the driver says. */
static unsigned says, idle;

static uint8_t any_frame(mavlink_message_t *message, mavlink_status_t *status)
{
    Frama_C_make_unknown((char *)message, sizeof *message);
    Frama_C_make_unknown((char *)status, sizeof *status);
    status->parse_state = (mavlink_parse_state_t)(idle != 0u
                    ? Frama_C_interval(MAVLINK_PARSE_STATE_UNINIT, MAVLINK_PARSE_STATE_IDLE)
                    : Frama_C_interval(MAVLINK_PARSE_STATE_IDLE + 1, MAVLINK_PARSE_STATE_SIGNATURE_WAIT_BAD_CRC));
    return (uint8_t)says;
}
#define mavlink_frame_char_buffer(message, status, byte, to, to_status) ((void)(byte), any_frame(message, status))
#include "reader.c"
#endif
#include ESEA_BINDING

#define ANY(x) Frama_C_make_unknown((char *)&(x), sizeof(x))

#ifdef ESEA_EVA_FRAME
static mavlink_message_t received;
static mavlink_status_t receiving;

static void any_memory(void)
{
    ANY(received);
    ANY(receiving);
    receiving.signing = NULL; /* assumed: reader.c checks no signature, signing.c does */
}

static void take(unsigned state)
{
    receiving.parse_state = (mavlink_parse_state_t)state;
    (void)mavlink_frame_char_buffer(
            &received, &receiving, (uint8_t)Frama_C_unsigned_int_interval(0u, 255u), NULL, NULL);
    /*@ assert signature_fits: receiving.parse_state == MAVLINK_PARSE_STATE_SIGNATURE_WAIT ||
            receiving.parse_state == MAVLINK_PARSE_STATE_SIGNATURE_WAIT_BAD_CRC ==>
            1 <= receiving.signature_wait <= MAVLINK_SIGNATURE_BLOCK_LEN; */
}

static void decode(void)
{
    esea_link_in_t in;
    esea_link_wanted_t wanted;
    uint32_t task, sequence, deadline_ms, boot, time_ms;

    ANY(received);
    (void)esea_link_decode(&received, &task, &sequence, &in);
    (void)esea_link_decode_wanted(&received, &wanted, &deadline_ms, &boot, &time_ms);
}

/* A byte in a state of the parser; where that is needed, for each value of what it counts. */
static void bytes_in(unsigned state)
{
    unsigned n;

    switch (state) {
    case MAVLINK_PARSE_STATE_GOT_PAYLOAD:
        /*@ loop unroll 256; */
        for (n = 0u; n < 256u; ++n) {
            any_memory();
            receiving.packet_idx = (uint8_t)n;
            take(state);
        }
        break;
    case MAVLINK_PARSE_STATE_GOT_CRC1:
    case MAVLINK_PARSE_STATE_GOT_BAD_CRC1:
        /*@ loop unroll 256; */
        for (n = 0u; n < 256u; ++n) {
            any_memory();
            received.incompat_flags = (uint8_t)n;
            take(state);
        }
        break;
    case MAVLINK_PARSE_STATE_SIGNATURE_WAIT:
    case MAVLINK_PARSE_STATE_SIGNATURE_WAIT_BAD_CRC:
        /*@ loop unroll 13; */
        for (n = 1u; n <= MAVLINK_SIGNATURE_BLOCK_LEN; ++n) { /* kept: signature_fits */
            any_memory();
            receiving.signature_wait = (uint8_t)n;
            take(state);
        }
        break;
    default:
        any_memory();
        take(state);
        break;
    }
}

int main(void)
{
    unsigned state;

    /*@ loop unroll 18; */
    for (state = 0u; state <= MAVLINK_PARSE_STATE_SIGNATURE_WAIT_BAD_CRC + 1u; ++state) {
        bytes_in(state);
    }
    decode();
    return 0;
}
#elif defined(ESEA_EVA_READER)
static esea_reader_t reader;

/* Any memory, with this many bytes gone to the parser. */
static void any_reader(unsigned next)
{
    ANY(reader);
    reader.next = next;
    reader.count = Frama_C_unsigned_int_interval(next, sizeof reader.bytes); /* kept: parser_behind */
}

static void check(void)
{
    /*@ assert parser_behind: reader.next <= reader.count <= MAVLINK_MAX_PACKET_LEN; */
}

/* One byte that waits, for each answer of the parser. */
static void byte_in(unsigned next)
{
    /*@ loop unroll 4; */
    for (says = MAVLINK_FRAMING_INCOMPLETE; says <= MAVLINK_FRAMING_BAD_SIGNATURE; ++says)
        /*@ loop unroll 2; */
        for (idle = 0u; idle < 2u; ++idle) {
            any_reader(next);
            reader.count = Frama_C_unsigned_int_interval(next + 1u, sizeof reader.bytes);
            (void)step(&reader);
            check();
        }
}

int main(void)
{
    unsigned n;

    /*@ loop unroll 281; */
    for (n = 0u; n <= MAVLINK_MAX_PACKET_LEN; ++n) {
        any_reader(n);
        esea_reader_put(&reader, (uint8_t)Frama_C_unsigned_int_interval(0u, 255u));
        check();
        any_reader(n);
        (void)esea_reader_pauses(&reader, Frama_C_unsigned_int_interval(0u, ESEA_FRAME_MS));
        check();
        any_reader(n);
        (void)esea_reader_pauses(&reader, Frama_C_unsigned_int_interval(ESEA_FRAME_MS + 1u, UINT32_MAX));
        check();
        if (n < MAVLINK_MAX_PACKET_LEN)
            byte_in(n);
    }
    return 0;
}
#elif defined(ESEA_EVA_SIGNATURE)
#define EITHER() (Frama_C_interval(0, 1) != 0)

/* Other files. */
uint32_t esea_now_ms(const esea_app_t *to) { (void)to; return Frama_C_unsigned_int_interval(0u, UINT32_MAX); }
bool esea_keep_key(esea_app_t *to, const uint8_t *key, uint64_t timestamp)
{
    (void)to;
    /*@ assert key_there: \valid_read(key + (0 .. 31)); */
    (void)key;
    (void)timestamp;
    return EITHER();
}
bool esea_kept_key(esea_app_t *to, uint8_t *key, uint64_t *timestamp)
{
    (void)to;
    Frama_C_make_unknown((char *)key, 32u);
    ANY(*timestamp);
    return EITHER();
}
void esea_send_text(esea_app_t *to, uint8_t severity, const char *first, const char *second)
{
    (void)to;
    (void)severity;
    /*@ assert texts_there: \valid_read(first) && \valid_read(second); */
    (void)first;
    (void)second;
}
void esea_send_ack(esea_app_t *app, const mavlink_message_t *to, uint16_t command, uint8_t result, bool late)
{
    (void)app;
    (void)to;
    (void)command;
    (void)result;
    (void)late;
}
void esea_parameters_error(esea_app_t *app, const mavlink_message_t *to, const char *id, int16_t index, uint8_t error)
{
    (void)app;
    (void)to;
    /*@ assert id_there: \valid_read(id + (0 .. 15)); */
    (void)id;
    (void)index;
    (void)error;
}

static esea_store_t store;
static esea_app_t app;
static mavlink_message_t received;

/* Any memory but for the port and the count of senders, which is kept: streams_fit. */
static void any_memory(const esea_port_t *port)
{
    const unsigned count = Frama_C_unsigned_int_interval(0u, MAVLINK_MAX_SIGNING_STREAMS);

    ANY(received);
    ANY(store.set.key);
    ANY(app.signing);
    app.signing.paired = EITHER();
    app.signing.streams.num_signing_streams = (uint16_t)count;
    app.state = (ESEA_STATE)Frama_C_interval(0, 11); /* assumed: machine.c's state_known */
    ANY(app.refused_ms);
    app.port = port;
}

static void check(void)
{
    /*@ assert streams_fit: app.signing.streams.num_signing_streams <= MAVLINK_MAX_SIGNING_STREAMS; */
}

int main(void)
{
    const esea_port_t port = {.store = EITHER() ? &store : NULL};
    unsigned n;

    any_memory(&port);
    esea_signing_start(&app);
    esea_signing_up(&app);
    check();
    any_memory(&port);
    esea_signing_setup(&app, &received);
    check();
    any_memory(&port);
    esea_signing_refuse(&app, &received);
    esea_refuse(&app, &received, "", EITHER());
    check();
    /*@ loop unroll 256; */
    for (n = 0u; n < 256u; ++n) {
        any_memory(&port);
        received.len = (uint8_t)n;
        (void)esea_signing_good(&app, &received);
        check();
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
