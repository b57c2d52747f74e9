/* Link traffic beside commands: streams, parameters, signatures.  Part of app.h, which the device's binding
 * precedes.
 *
 * License: MIT. */
#ifndef ESEA_WIRE_H
#define ESEA_WIRE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define ESEA_BLOCKS 4u /* messages of a stream that may wait, the one that is filled among them */

struct esea_app;

/* A message of a stream while it is filled, and until it is sent. */
typedef struct {
    uint64_t time; /* of its first sample, base ticks since power-on */
    uint32_t tick; /* base tick of its run */
    uint32_t count;
    uint32_t words[ESEA_LINK_STREAM_WORDS];
} esea_block_t;

/* A stream belongs to one task, whose runs write `head`, the main loop `tail`; both run free.  What is
 * chosen changes in the main loop, which runs only when no run does. */
typedef struct {
    uint32_t interval; /* base ticks; 0: off */
    uint32_t task;
    uint32_t width;    /* values in a sample */
    uint32_t samples;  /* in a message */
    uint32_t count;    /* in the one that is filled */
    uint32_t left_out; /* samples still to be left out: their message found no room */
    uint32_t filled, dropped; /* messages; they stay at their maximum */
    uint8_t choice;
    uint8_t signals[ESEA_LINK_STREAM_WORDS];
    volatile uint32_t head, tail;
    esea_block_t blocks[ESEA_BLOCKS];
} esea_stream_t;

/* All that the next ticks come from: written by the tick, sent by the main loop while it `waits`. */
typedef struct {
    uint32_t interval; /* base ticks; 0: none */
    uint32_t tick;     /* at whose start it was taken */
    uint32_t sent;     /* words of it */
    volatile bool asked, waits;
    uint32_t words[ESEA_LINK_KEY_WORDS];
} esea_key_t;

/* What became of a value that was kept. */
typedef enum {
    ESEA_KEPT_TAKEN = 0,
    ESEA_KEPT_CLIPPED = 1,     /* a limit beyond its bounds: the bound that is next to it */
    ESEA_KEPT_OUTSIDE = 2,     /* beyond its bounds, or no number: the default */
    ESEA_KEPT_CONFLICTING = 3, /* refused beside the others: the default */
} ESEA_KEPT_VALUE;

typedef struct {
    uint32_t listed;  /* parameter that a list tells next */
    uint32_t told;    /* what is said next of kept values */
    uint32_t refused; /* stays at its maximum */
    uint8_t found[ESEA_LINK_PARAMETERS + 1u]; /* an ESEA_KEPT_VALUE each, when they were loaded */
} esea_parameters_t;

typedef struct {
    bool paired;
    mavlink_signing_t key;
    uint64_t most; /* no timestamp above this is taken, for the next start begins beyond it */
    mavlink_signing_streams_t streams;
    uint32_t unsigned_refused, bad, replayed; /* they stay at their maximum */
} esea_signing_t;

/* What has come of a frame, and the last whole one.  Where bytes turn out to be no frame, it looks for others from
 * their second byte on, so that half a frame hides none that follows. */
typedef struct {
    mavlink_message_t message;
    mavlink_status_t status;
    uint8_t bytes[MAVLINK_MAX_PACKET_LEN];
    uint32_t count, next; /* bytes, and how many of them the parser has had */
    uint32_t bad;         /* of them in a bad frame that has been counted */
} esea_reader_t;

typedef enum {
    ESEA_READ_NOTHING = 0, /* give it more bytes */
    ESEA_READ_FRAME = 1,   /* `message` */
    ESEA_READ_BAD = 2,     /* a frame whose checksum is wrong, or that nobody knows */
} ESEA_READ;

/* The board's time as the host knew it, for the next frame of the same sender. */
typedef struct {
    bool there;
    uint8_t system, component, sequence; /* of that frame */
    uint32_t boot, time_ms;
} esea_stamp_t;

/* Somebody beside the host who commands: a stop is taken from anybody.  Answers wait here. */
typedef struct {
    esea_reader_t reader;
    mavlink_status_t sending;
    uint32_t heard_ms; /* when something came last */
    uint8_t answer[512];
    size_t answered;
} esea_guest_t;

/* -- reader.c ---------------------------------------------------------------------------------- */

/* After each byte, until it says NOTHING. */
void esea_reader_put(esea_reader_t *reader, uint8_t byte);
ESEA_READ esea_reader_next(esea_reader_t *reader);
/* Whether nothing has come for longer than a frame may pause: then it takes it for none. */
bool esea_reader_pauses(esea_reader_t *reader, uint32_t silence_ms);

/* -- streams.c --------------------------------------------------------------------------------- */

/* After a run of a task, at its priority. */
void esea_streams_take(struct esea_app *app, uint32_t task, uint32_t tick, uint64_t time, uint32_t step_ticks);

/* A message of a stream that waits; false when none does. */
bool esea_streams_send(struct esea_app *app, uint32_t number);
bool esea_streams_wait(const struct esea_app *app);
void esea_streams_choose(struct esea_app *app, const mavlink_message_t *message);

/* -- key.c ------------------------------------------------------------------------------------- */

void esea_key_ask(struct esea_app *app);
void esea_key_take(struct esea_app *app, uint32_t tick);
/* At most one message. */
bool esea_key_send(struct esea_app *app);

/* -- parameters.c ------------------------------------------------------------------------------ */

/* At power-on: defaults, then what was kept. */
void esea_parameters_start(struct esea_app *app);
void esea_parameters_read(struct esea_app *app, const mavlink_message_t *message);
void esea_parameters_list(struct esea_app *app);
void esea_parameters_set(struct esea_app *app, const mavlink_message_t *message);
void esea_parameters_error(struct esea_app *app, const mavlink_message_t *to, const char *id, int16_t index,
        uint8_t error);

/* The command PREFLIGHT_STORAGE; its result. */
uint8_t esea_parameters_storage(struct esea_app *app, float action);

/* Says what the board has to say, then, a text a turn of the main loop, which kept values are not in force, and how
 * many are. */
void esea_parameters_tell(struct esea_app *app);

/* The next one of a list or text that was asked for; false when there is none. */
bool esea_parameters_send(struct esea_app *app);

/* -- signing.c --------------------------------------------------------------------------------- */

void esea_signing_start(struct esea_app *app);
void esea_signing_setup(struct esea_app *app, const mavlink_message_t *message);

/* Whether whoever sent it may command; each frame once. */
bool esea_signing_good(struct esea_app *app, const mavlink_message_t *message);

/* A frame that was not good has been refused: counts it, and says so. */
void esea_signing_refuse(struct esea_app *app, const mavlink_message_t *message);

/* From the main loop: makes room for more timestamps, while the motor is off. */
void esea_signing_up(struct esea_app *app);

/* Answers a frame that is not taken.  `late`: for its age. */
void esea_refuse(struct esea_app *app, const mavlink_message_t *message, const char *why, bool late);

/* -- keep.c: what a board keeps without power; it changes no state of the application -------------- */

/* False where nothing can be kept.  Those that a calibration sets are left out. */
bool esea_keep_parameters(struct esea_app *app);

/* What is kept of parameters: how many, and where. */
uint32_t esea_kept_parameters(const struct esea_app *app, const esea_store_parameter_t **kept);

/* Zeros that were kept for the encoders that are fitted into force; false, and none in force, where there is
 * not one for each.  True where the device has no encoder with a zero. */
bool esea_kept_zeros(struct esea_app *app);

/* Keeps the zeros that were taken, or forgets those that were kept, as long as nobody takes others. */
void esea_keep_zeros(struct esea_app *app);
void esea_forget_zeros(struct esea_app *app);

/* From the main loop: forgets zeros that are in doubt and saves counters that have changed, while the motor is
 * off. */
void esea_keep_up(struct esea_app *app);

/* Whether these may be the encoders that are fitted, by ESEA_STORE_ENCODERS serial numbers, as a MAV_RESULT; and
 * keeps them, before a reset. */
uint8_t esea_keep_may_fit(const struct esea_app *app, const uint32_t *serials);
void esea_keep_fitted(struct esea_app *app, const uint32_t *serials);

/* At power-on: what the couplings have borne, from the store. */
void esea_kept_lives(struct esea_app *app);

/* The coupling that is fitted, by its serial number; 255 for the coupling forgets one that lies aside.  A
 * MAV_RESULT. */
uint8_t esea_keep_coupling(struct esea_app *app, uint32_t coupling, uint32_t serial);

/* A key of zeros: nobody's. */
bool esea_keep_key(struct esea_app *app, const uint8_t *key, uint64_t timestamp);
bool esea_kept_key(struct esea_app *app, uint8_t *key, uint64_t *timestamp);

#endif
