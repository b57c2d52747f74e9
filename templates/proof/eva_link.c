/* What the value analysis is asked of link.c: messages of any content, signed or not, stamped or not, at any time,
 * turns of the main loop and guests, any number in any order, from power on.  What it calls in other files answers
 * anything, the reader any message; the application's own memory is touched by link.c alone, and its state, which is
 * any known one.
 *
 * License: MIT. */
#include "__fc_builtin.h"

#include "link.c"
#include ESEA_BINDING

#define ANY(x) Frama_C_make_unknown((char *)&(x), sizeof(x))
#define EITHER() (Frama_C_interval(0, 1) != 0)
#define ANY8() ((uint8_t)Frama_C_unsigned_int_interval(0u, UINT8_MAX))
#define ANY32() Frama_C_unsigned_int_interval(0u, UINT32_MAX)

/* -- other files ------------------------------------------------------------------------------- */

static bool taken(esea_app_t *app)
{
    app->state = (ESEA_STATE)Frama_C_interval(0, 11); /* assumed: machine.c's state_known */
    return EITHER();
}

bool esea_app_event(esea_app_t *app, ESEA_EVENT event) { (void)event; return taken(app); }
bool esea_app_ask(esea_app_t *app, ESEA_EVENT event) { (void)event; return taken(app); }
bool esea_app_reset(esea_app_t *app) { return taken(app); }
void esea_app_check_stack(esea_app_t *app) { (void)taken(app); }
void esea_app_end_zeroing(esea_app_t *app) { (void)taken(app); }
uint32_t esea_app_measure(esea_app_t *app, uint32_t task, const esea_link_in_t *in, esea_link_out_t *out)
{
    (void)app;
    /*@ assert task_there: task < ESEA_LINK_TASKS; */
    (void)task;
    (void)in;
    ANY(*out);
    return ANY32();
}
void esea_elbow_drive_release(esea_elbow_drive_state_t *state, uint32_t tick) { ANY(*state); (void)tick; }

void esea_send(esea_app_t *app, const mavlink_message_t *message) { (void)app; (void)message; }
void esea_send_heartbeat(esea_app_t *app) { (void)app; }
void esea_send_info(esea_app_t *app) { (void)app; }
void esea_send_stamp(esea_app_t *app) { (void)app; }
uint32_t esea_now_ms(const esea_app_t *app) { (void)app; return ANY32(); }
void esea_send_clock(esea_app_t *app) { (void)app; }
void esea_send_traffic(esea_app_t *app) { (void)app; }
void esea_send_kept(esea_app_t *app, uint8_t result) { (void)app; (void)result; }
void esea_send_blackbox(esea_app_t *app, uint32_t first) { (void)app; (void)first; }
void esea_send_life(esea_app_t *app, uint32_t number, uint8_t result)
{
    (void)app;
    (void)number;
    (void)result;
}
void esea_send_time(esea_app_t *app, int64_t asked_ns) { (void)app; (void)asked_ns; }
bool esea_send_runs(esea_app_t *app) { (void)app; return EITHER(); }
void esea_send_ack(esea_app_t *app, const mavlink_message_t *to, uint16_t command, uint8_t result, bool late)
{
    (void)app;
    (void)to;
    (void)command;
    (void)result;
    (void)late;
}
void esea_send_text(esea_app_t *app, uint8_t severity, const char *first, const char *second)
{
    (void)app;
    (void)severity;
    /*@ assert texts_there: \valid_read(first) && \valid_read(second); */
    (void)first;
    (void)second;
}

void esea_key_ask(esea_app_t *app) { (void)app; }
bool esea_key_send(esea_app_t *app) { app->key.waits = EITHER(); return EITHER(); }
uint8_t esea_parameters_storage(esea_app_t *app, float action) { (void)app; (void)action; return ANY8(); }
void esea_parameters_read(esea_app_t *app, const mavlink_message_t *message) { (void)app; (void)message; }
void esea_parameters_list(esea_app_t *app) { (void)app; }
void esea_parameters_set(esea_app_t *app, const mavlink_message_t *message) { (void)app; (void)message; }
bool esea_parameters_send(esea_app_t *app) { (void)app; return EITHER(); }
void esea_parameters_tell(esea_app_t *app) { (void)app; }
void esea_streams_choose(esea_app_t *app, const mavlink_message_t *message) { (void)app; (void)message; }
bool esea_streams_wait(const esea_app_t *app) { (void)app; return EITHER(); }
bool esea_streams_send(esea_app_t *app, uint32_t number)
{
    (void)app;
    /*@ assert stream_there: number < ESEA_LINK_STREAMS; */
    (void)number;
    return EITHER();
}
void esea_signing_setup(esea_app_t *app, const mavlink_message_t *message) { (void)app; (void)message; }
bool esea_signing_good(esea_app_t *app, const mavlink_message_t *message)
{
    (void)app;
    (void)message;
    return EITHER();
}
void esea_signing_up(esea_app_t *app) { (void)app; }
void esea_signing_refuse(esea_app_t *app, const mavlink_message_t *message) { (void)app; (void)message; }
void esea_refuse(esea_app_t *app, const mavlink_message_t *message, const char *why, bool late)
{
    (void)app;
    (void)message;
    /*@ assert reason_there: \valid_read(why); */
    (void)why;
    (void)late;
}
void esea_reader_put(esea_reader_t *reader, uint8_t byte) { (void)reader; (void)byte; }
ESEA_READ esea_reader_next(esea_reader_t *reader)
{
    ANY(reader->message);
    return (ESEA_READ)Frama_C_interval(ESEA_READ_NOTHING, ESEA_READ_BAD);
}
bool esea_reader_pauses(esea_reader_t *reader, uint32_t silence_ms)
{
    (void)reader;
    (void)silence_ms;
    return EITHER();
}
uint8_t esea_keep_may_fit(const esea_app_t *app, const uint32_t *serials)
{
    (void)app;
    /*@ assert serials_there: \initialized(serials + (0 .. ESEA_STORE_ENCODERS - 1)); */
    (void)serials;
    return EITHER() ? (uint8_t)MAV_RESULT_ACCEPTED : ANY8();
}
uint8_t esea_keep_coupling(esea_app_t *app, uint32_t coupling, uint32_t serial)
{
    (void)app;
    (void)coupling;
    (void)serial;
    return ANY8();
}
void esea_keep_fitted(esea_app_t *app, const uint32_t *serials) { (void)app; (void)serials; }
void esea_keep_up(esea_app_t *app) { (void)app; }
void esea_blackbox_release(esea_blackbox_t *box) { /*@ assert box_there: \valid(box); */ (void)box; }

/* -- the port ---------------------------------------------------------------------------------- */

static size_t port_read(uint8_t *bytes, size_t capacity)
{
    Frama_C_make_unknown((char *)bytes, capacity);
    return Frama_C_unsigned_int_interval(0u, capacity); /* assumed: no more than it was told */
}
static void port_quiet(bool on) { (void)on; }
static void port_wait(void) {}
static bool port_room(void) { return EITHER(); }

static esea_blackbox_t box;
static esea_app_t app;
static esea_guest_t guest;

int main(void)
{
    uint8_t bytes[64];
    const esea_port_t port = {
        .read = port_read,
        .quiet = port_quiet,
        .wait = port_wait,
        .room = EITHER() ? port_room : NULL,
        .blackbox = EITHER() ? &box : NULL,
    };

    app.port = &port;
    while (EITHER()) {
        ANY(app.reader.message);
        ANY(app.boot);
        ANY(bytes);
        ANY(app.clock.tick);
        app.motion.zeroing_ends = EITHER();
        app.motion.not_armed = EITHER();
        app.fault = (ESEA_FAULT)Frama_C_interval(0, 127);
        switch (Frama_C_interval(0, 4)) {
        case 0:
            run_message(&app);
            break;
        case 1:
            run_stranger(&app);
            break;
        case 2:
            esea_app_greet(&app, &guest, "somebody");
            break;
        case 3:
            esea_app_overhear(&app, &guest, bytes, Frama_C_unsigned_int_interval(0u, sizeof bytes), EITHER());
            break;
        default:
            esea_app_poll(&app);
            break;
        }
    }
    return 0;
}
