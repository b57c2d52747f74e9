/* Frames out.
 *
 * License: MIT. */
#include "app.h"
#include "rainflow.h"

#include <math.h>
#include <string.h>

/* Puts a text into a field; one as long as the field stands there without a terminator. */
static void put_text(char *field, size_t size, const char *text)
{
    size_t i;

    for (i = 0u; i < size && text[i] != '\0'; ++i)
        field[i] = text[i];
}

void esea_send(esea_app_t *app, const mavlink_message_t *message)
{
    uint8_t frame[MAVLINK_MAX_PACKET_LEN];

    const size_t count = mavlink_msg_to_send_buffer(frame, message);
    esea_guest_t *const guest = app->guest;

    if (guest == NULL) {
        app->port->write(frame, count);
    } else if (count <= sizeof guest->answer - guest->answered) {
        memcpy(&guest->answer[guest->answered], frame, count);
        guest->answered += count;
    }
}

void esea_send_heartbeat(esea_app_t *app)
{
    static const uint8_t states[] = {
        [ESEA_STATE_BOOT] = MAV_STATE_BOOT,
        [ESEA_STATE_SELF_TEST] = MAV_STATE_BOOT,
        [ESEA_STATE_UNREFERENCED] = MAV_STATE_STANDBY,
        [ESEA_STATE_ZEROING] = MAV_STATE_CALIBRATING,
        [ESEA_STATE_READY] = MAV_STATE_STANDBY,
        [ESEA_STATE_ARMED] = MAV_STATE_ACTIVE,
        [ESEA_STATE_ACTIVE] = MAV_STATE_ACTIVE,
        [ESEA_STATE_LETTING_GO] = MAV_STATE_ACTIVE,
        [ESEA_STATE_STOPPED] = MAV_STATE_STANDBY,
        [ESEA_STATE_STOPPING] = MAV_STATE_ACTIVE,
        [ESEA_STATE_FAULT] = MAV_STATE_CRITICAL,
        [ESEA_STATE_REPLAY] = MAV_STATE_ACTIVE,
    };
    mavlink_heartbeat_t fields;

    memset(&fields, 0, sizeof fields);
    fields.type = MAV_TYPE_GENERIC;
    fields.autopilot = MAV_AUTOPILOT_INVALID;
    fields.base_mode = MAV_MODE_FLAG_CUSTOM_MODE_ENABLED;
    if (esea_state_drives(app->state))
        fields.base_mode |= MAV_MODE_FLAG_SAFETY_ARMED;
    fields.custom_mode = (uint32_t)app->state;
    fields.system_status = esea_state_known(app->state) ? states[app->state] : (uint8_t)MAV_STATE_CRITICAL;
    if (app->fault == ESEA_FAULT_PROCESSOR)
        fields.system_status = MAV_STATE_EMERGENCY;
    ESEA_SEND(app, heartbeat, fields);
}

void esea_send_info(esea_app_t *app)
{
    mavlink_esea_info_t fields;

    memset(&fields, 0, sizeof fields);
    fields.tick_us = ESEA_LINK_TICK_US;
    fields.fault = (uint32_t)app->fault;
    fields.steps = app->steps;
    fields.sequence_gaps = app->sequence_gaps;
    fields.bad_frames = app->bad_frames;
    fields.unknown_messages = app->unknown_messages;
    fields.lost_bytes = app->port->lost_bytes();
    fields.receive_buffer_bytes = app->port->receive_buffer_bytes;
    fields.empty_ticks = app->empty_ticks;
    fields.stack_bytes = app->port->stack_bytes;
    fields.stack_peak_bytes = app->port->stack_peak_bytes();
    put_text(fields.content_hash, sizeof fields.content_hash, ESEA_LINK_CONTENT_HASH);
    put_text(fields.device, sizeof fields.device, ESEA_LINK_DEVICE);
    put_text(fields.board, sizeof fields.board, app->port->name);
    ESEA_SEND(app, esea_info, fields);
}

void esea_send_clock(esea_app_t *app)
{
    const esea_motion_t *const motion = &app->motion;
    mavlink_esea_clock_t fields;

    memset(&fields, 0, sizeof fields);
    fields.tick = app->clock.tick;
    fields.lost_ticks = app->clock.lost_ticks;
    fields.missed_runs = app->clock.missed_runs;
    fields.late_runs = esea_link_late_runs(&app->control);
    fields.dropped = app->clock.dropped;
    fields.refused = motion->refused;
    fields.deadline_left = motion->deadline_left;
    fields.state = (uint32_t)app->state;
    ESEA_SEND(app, esea_clock, fields);
}

void esea_send_kept(esea_app_t *app, uint8_t result)
{
    const esea_store_t *const store = app->port->store;
    mavlink_esea_kept_t fields;
    uint32_t i;

    memset(&fields, 0, sizeof fields);
    for (i = 0u; i < ESEA_STORE_ENCODERS; ++i)
        fields.zero_rad[i] = NAN;
    if (store != NULL) {
        for (i = 0u; i < ESEA_STORE_ENCODERS; ++i) {
            const esea_store_encoder_t *const encoder = esea_store_encoder(store, store->set.fitted[i]);

            fields.serial[i] = store->set.fitted[i];
            fields.zero_rad[i] = encoder != NULL ? encoder->zero_rad : NAN;
        }
        fields.starts = store->set.use.starts;
        fields.armings = store->set.use.armings;
        fields.faults = store->set.use.faults;
        fields.watchdog_resets = store->set.use.watchdog_resets;
        fields.saves = store->set.use.saves;
        fields.active_s = store->set.use.active_s;
    }
    fields.encoders = ESEA_LINK_ENCODERS;
    fields.zero = app->zero;
    fields.result = result;
    ESEA_SEND(app, esea_kept, fields);
}

/* What is kept is sent whole. */
typedef char esea_life_classes[MAVLINK_MSG_ESEA_LIFE_FIELD_HALVES_LEN == ESEA_LIFE_CLASSES ? 1 : -1];

void esea_send_life(esea_app_t *app, uint32_t number, uint8_t result)
{
    const uint32_t couplings = ESEA_LINK_COUPLINGS;
    const esea_store_t *const store = app->port->store;
    esea_store_life_t life;
    mavlink_esea_life_t fields;

    memset(&fields, 0, sizeof fields);
    memset(&life, 0, sizeof life);
    if (number < couplings) {
        app->port->quiet(true);
        life = app->life[number].kept;
        app->port->quiet(false);
    } else if (store != NULL && number - couplings < ESEA_STORE_LIVES &&
               store->set.life[number - couplings].place == 0u) {
        life = store->set.life[number - couplings];
    }
    fields.serial = life.serial;
    fields.seconds = life.seconds;
    fields.full = life.full;
    fields.energy_J = (float)life.joules + life.part_J;
    fields.width_rad = 2.0f * esea_link_coupling_rad(number < couplings ? number : 0u) / (float)ESEA_LIFE_CLASSES;
    esea_rainflow_halves(&life, fields.halves);
    fields.number = (uint8_t)number;
    fields.couplings = (uint8_t)couplings;
    fields.records = (uint8_t)(couplings + (store != NULL ? ESEA_STORE_LIVES : 0u));
    fields.result = result;
    ESEA_SEND(app, esea_life, fields);
}

void esea_send_blackbox(esea_app_t *app, uint32_t first)
{
    const esea_blackbox_t *const box = app->port->blackbox;
    esea_blackbox_record_t record;
    mavlink_esea_blackbox_t fields;

    memset(&fields, 0, sizeof fields);
    fields.first = first;
    fields.size = sizeof record;
    if (box != NULL && esea_blackbox_frozen(box)) {
        fields.count = esea_blackbox_count(box);
        fields.fault = box->fault;
        fields.tick = box->tick;
    }
    while (first < fields.count && (fields.records + 1u) * sizeof record <= sizeof fields.data) {
        if (esea_blackbox_read(box, first, &record))
            fields.whole |= (uint8_t)(1u << fields.records);
        memcpy(&fields.data[fields.records * sizeof record], &record, sizeof record);
        ++fields.records;
        ++first;
    }
    ESEA_SEND(app, esea_blackbox, fields);
}

void esea_send_traffic(esea_app_t *app)
{
    mavlink_esea_traffic_t fields;
    uint32_t i;

    memset(&fields, 0, sizeof fields);
    for (i = 0u; i < ESEA_LINK_STREAMS; ++i) {
        fields.stream_messages += app->streams[i].filled;
        fields.stream_dropped += app->streams[i].dropped;
    }
    fields.paired = app->signing.paired ? 1u : 0u;
    fields.unsigned_refused = app->signing.unsigned_refused;
    fields.bad_signatures = app->signing.bad;
    fields.replayed = app->signing.replayed;
    fields.parameters_refused = app->parameters.refused;
    fields.expired = app->expired;
    ESEA_SEND(app, esea_traffic, fields);
}

void esea_send_ack(esea_app_t *app, const mavlink_message_t *to, uint16_t command, uint8_t result, bool late)
{
    mavlink_command_ack_t fields;

    memset(&fields, 0, sizeof fields);
    fields.command = command;
    fields.result = result;
    fields.result_param2 = late ? 1 : 0;
    fields.target_system = to->sysid;
    fields.target_component = to->compid;
    ESEA_SEND(app, command_ack, fields);
}

void esea_send_text(esea_app_t *app, uint8_t severity, const char *first, const char *second)
{
    const size_t length = strlen(first);
    mavlink_statustext_t fields;

    memset(&fields, 0, sizeof fields);
    fields.severity = severity;
    put_text(fields.text, sizeof fields.text, first);
    if (length < sizeof fields.text)
        put_text(fields.text + length, sizeof fields.text - length, second);
    ESEA_SEND(app, statustext, fields);
}

/* The device clock; between two base ticks by the counter, where there is one. */
static uint64_t now_ns(const esea_app_t *app)
{
    const uint32_t base = app->port->base_ticks;
    uint64_t time;
    uint32_t since;

    app->port->quiet(true);
    time = app->clock.time;
    since = app->port->ticks() - app->clock.last_count;
    app->port->quiet(false);
    time *= ESEA_LINK_TICK_US * UINT32_C(1000);
    if (app->clock.timed && base > 0u)
        time += (uint64_t)(since < base ? since : base) * (ESEA_LINK_TICK_US * UINT32_C(1000)) / base;
    return time;
}

uint32_t esea_now_ms(const esea_app_t *app)
{
    uint64_t time;

    app->port->quiet(true);
    time = app->clock.time;
    app->port->quiet(false);
    return (uint32_t)(time * ESEA_LINK_TICK_US / 1000u);
}

void esea_send_stamp(esea_app_t *app)
{
    mavlink_esea_stamp_t fields;

    memset(&fields, 0, sizeof fields);
    fields.signature = app->signing.key.timestamp;
    fields.boot = app->boot;
    fields.time_ms = esea_now_ms(app);
    ESEA_SEND(app, esea_stamp, fields);
}

void esea_send_time(esea_app_t *app, int64_t asked_ns)
{
    mavlink_timesync_t fields;

    memset(&fields, 0, sizeof fields);
    fields.tc1 = (int64_t)now_ns(app) + 1; /* 0 would be a request; the nanosecond does not matter */
    fields.ts1 = asked_ns;
    ESEA_SEND(app, timesync, fields);
}

bool esea_send_runs(esea_app_t *app)
{
    mavlink_message_t message;
    uint32_t number;
    bool any = false;

    for (number = 0u; number < ESEA_LINK_TASKS; ++number) {
        esea_task_t *const task = &app->tasks[number];

        const esea_run_t *const run = &task->runs[task->tail % ESEA_RUNS_KEPT];

        if (task->tail == task->head)
            continue;
        if (run->send[0]) {
            esea_link_encode_in(number, run->tick, &run->in, &app->sending, &message);
            esea_send(app, &message);
        }
        if (run->send[1]) {
            esea_link_encode(number, run->tick, run->step_ticks, &run->out, &app->sending, &message);
            esea_send(app, &message);
        }
        task->tail = task->tail + 1u;
        any = true;
    }
    return any;
}
