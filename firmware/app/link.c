/* Frames in, frames out.
 *
 * License: MIT. */
#include "app.h"

#include <string.h>

/* Puts a text into a field; one as long as the field stands there without a terminator. */
static void put_text(char *field, size_t size, const char *text)
{
    size_t i;

    for (i = 0u; i < size && text[i] != '\0'; ++i)
        field[i] = text[i];
}

static void send(esea_app_t *app, const mavlink_message_t *message)
{
    uint8_t frame[MAVLINK_MAX_PACKET_LEN];

    app->port->write(frame, mavlink_msg_to_send_buffer(frame, message));
}

void esea_link_send_heartbeat(esea_app_t *app)
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
        [ESEA_STATE_FAULT] = MAV_STATE_CRITICAL,
        [ESEA_STATE_REPLAY] = MAV_STATE_ACTIVE,
    };
    mavlink_heartbeat_t fields;
    mavlink_message_t message;

    memset(&fields, 0, sizeof fields);
    fields.type = MAV_TYPE_GENERIC;
    fields.autopilot = MAV_AUTOPILOT_INVALID;
    fields.base_mode = MAV_MODE_FLAG_CUSTOM_MODE_ENABLED;
    fields.custom_mode = (uint32_t)app->state;
    fields.system_status = esea_state_known(app->state) ? states[app->state] : (uint8_t)MAV_STATE_CRITICAL;
    if (app->fault == ESEA_FAULT_PROCESSOR)
        fields.system_status = MAV_STATE_EMERGENCY;
    (void)mavlink_msg_heartbeat_encode_status(ESEA_LINK_SYSTEM, ESEA_LINK_COMPONENT, &app->sending, &message, &fields);
    send(app, &message);
}

static void send_info(esea_app_t *app)
{
    mavlink_esea_info_t fields;
    mavlink_message_t message;

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
    (void)mavlink_msg_esea_info_encode_status(ESEA_LINK_SYSTEM, ESEA_LINK_COMPONENT, &app->sending, &message, &fields);
    send(app, &message);
}

static void send_clock(esea_app_t *app)
{
    const esea_motion_t *const motion = &app->motion;
    mavlink_esea_clock_t fields;
    mavlink_message_t message;

    memset(&fields, 0, sizeof fields);
    fields.tick = app->clock.tick;
    fields.lost_ticks = app->clock.lost_ticks;
    fields.missed_runs = app->clock.missed_runs;
    fields.late_runs = esea_link_late_runs(&app->control);
    fields.dropped = app->clock.dropped;
    fields.refused = motion->refused;
    fields.deadline_left = motion->deadline_left;
    fields.state = (uint32_t)app->state;
    (void)mavlink_msg_esea_clock_encode_status(ESEA_LINK_SYSTEM, ESEA_LINK_COMPONENT, &app->sending, &message, &fields);
    send(app, &message);
}

void esea_link_send_waiting(esea_app_t *app)
{
    mavlink_message_t message;
    uint32_t number;

    for (number = 0u; number < ESEA_LINK_TASKS; ++number) {
        esea_task_t *const task = &app->tasks[number];

        while (task->tail != task->head) {
            const esea_run_t *const run = &task->runs[task->tail % ESEA_RUNS_KEPT];

            if (run->send[0]) {
                esea_link_encode_in(number, run->tick, &run->in, &app->sending, &message);
                send(app, &message);
            }
            if (run->send[1]) {
                esea_link_encode(number, run->tick, run->step_ticks, &run->out, &app->sending, &message);
                send(app, &message);
            }
            task->tail = task->tail + 1u;
        }
    }
    if (app->clock.tick - app->clock.told_tick >= ESEA_LINK_HEARTBEAT_EVERY) {
        app->clock.told_tick = app->clock.tick;
        esea_app_check_stack(app);
        app->told = ESEA_STATE_BOOT; /* so that it is sent */
    }
    /* The answers of a replay tell of it. */
    if (app->told != app->state && app->state != ESEA_STATE_REPLAY)
        esea_link_send_heartbeat(app);
    app->told = app->state;
}

/* Timer ticks of a step, those of measuring it included. */
uint32_t esea_link_measure(esea_app_t *app, uint32_t task, const esea_link_in_t *in, esea_link_out_t *out)
{
    /* volatile: the compiler must call a step and the one that does nothing in the same way. */
    esea_link_step_fn *volatile step = esea_link_step(task);
    uint32_t start, stop;

    app->port->quiet(true);
    start = app->port->ticks();
    step(&app->control, in, out);
    stop = app->port->ticks();
    app->port->quiet(false);
    return stop - start;
}

static void replay_task(esea_app_t *app, uint32_t task, uint32_t sequence, const esea_link_in_t *in)
{
    esea_link_out_t out;
    mavlink_message_t message;
    uint32_t ticks;

    if (!esea_app_ask(app, ESEA_EVENT_INPUT)) {
        esea_link_send_heartbeat(app); /* the answer to every input that is not taken */
        return;
    }
    if (app->started[task] && sequence != app->next_tick[task])
        esea_count(&app->sequence_gaps);
    app->started[task] = true;
    app->next_tick[task] = sequence + esea_link_every(task);

    /* Once a tick, before its first task: a second release would show what that task just wrote. */
    if (!app->released || sequence != app->released_tick)
        esea_link_release(&app->control, sequence);
    app->released = true;
    app->released_tick = sequence;
    ticks = esea_link_measure(app, task, in, &out);
    esea_count(&app->steps);
    esea_link_encode(task, sequence, ticks, &out, &app->sending, &message);
    send(app, &message);
    if (app->steps % ESEA_LINK_HEARTBEAT_EVERY == 0u) {
        esea_app_check_stack(app);
        esea_link_send_heartbeat(app);
    }
}

/* Runs of a task are told at an interval, in microseconds; 0 and less: none. */
static uint8_t set_interval(esea_app_t *app, float id, float interval_us)
{
    uint32_t number, side;

    for (number = 0u; number < ESEA_LINK_TASKS; ++number)
        for (side = 0u; side < ESEA_SIDES; ++side) {
            const uint32_t every = esea_link_every(number);
            uint32_t ticks = 0u;

            if (id != (float)esea_link_message(number, side))
                continue;
            if (!(interval_us <= 1e9f)) /* NaN too */
                return MAV_RESULT_DENIED;
            if (interval_us > 0.0f)
                ticks = ((uint32_t)interval_us / ESEA_LINK_TICK_US + every - 1u) / every * every;
            app->tasks[number].interval[side] = interval_us > 0.0f && ticks == 0u ? every : ticks;
            return MAV_RESULT_ACCEPTED;
        }
    return MAV_RESULT_DENIED;
}

static uint8_t ask(esea_app_t *app, ESEA_EVENT event)
{
    return (uint8_t)(esea_app_ask(app, event) ? MAV_RESULT_ACCEPTED : MAV_RESULT_TEMPORARILY_REJECTED);
}

static uint8_t do_command(esea_app_t *app, const mavlink_command_long_t *command)
{
    switch (command->command) {
    case ESEA_LINK_CMD_RESET:
        if (!esea_app_ask(app, ESEA_EVENT_RESET))
            return MAV_RESULT_TEMPORARILY_REJECTED;
        return esea_app_reset(app) ? MAV_RESULT_ACCEPTED : MAV_RESULT_FAILED;
    case ESEA_LINK_CMD_ZERO:
        return ask(app, ESEA_EVENT_ZERO);
    case ESEA_LINK_CMD_CLEAR:
        return ask(app, ESEA_EVENT_CLEAR);
    case ESEA_LINK_CMD_STOP:
        return ask(app, ESEA_EVENT_STOP);
    case ESEA_LINK_CMD_RELEASE:
        return ask(app, ESEA_EVENT_RELEASE);
    case MAV_CMD_COMPONENT_ARM_DISARM:
        /* Anything but a clear yes switches off. */
        return ask(app, command->param1 == 1.0f ? ESEA_EVENT_ARM : ESEA_EVENT_DISARM);
    case MAV_CMD_SET_MESSAGE_INTERVAL:
        return set_interval(app, command->param1, command->param2);
    default:
        return MAV_RESULT_UNSUPPORTED;
    }
}

static void run_command(esea_app_t *app, const mavlink_message_t *received)
{
    mavlink_command_long_t command;
    mavlink_command_ack_t ack;
    mavlink_message_t message;
    bool heartbeat = false, info = false, clock = false;

    mavlink_msg_command_long_decode(received, &command);
    /* A stop is taken whoever it is for. */
    if (command.command != ESEA_LINK_CMD_STOP &&
        ((command.target_system != 0u && command.target_system != ESEA_LINK_SYSTEM) ||
         (command.target_component != 0u && command.target_component != ESEA_LINK_COMPONENT)))
        return;

    memset(&ack, 0, sizeof ack);
    ack.command = command.command;
    ack.target_system = received->sysid;
    ack.target_component = received->compid;
    if (command.command == MAV_CMD_REQUEST_MESSAGE) {
        /* Message ids are exact in a float; NaN equals none. */
        heartbeat = command.param1 == (float)MAVLINK_MSG_ID_HEARTBEAT;
        info = command.param1 == (float)MAVLINK_MSG_ID_ESEA_INFO;
        clock = command.param1 == (float)MAVLINK_MSG_ID_ESEA_CLOCK;
        ack.result = heartbeat || info || clock ? MAV_RESULT_ACCEPTED : MAV_RESULT_DENIED;
    } else {
        ack.result = do_command(app, &command);
    }
    (void)mavlink_msg_command_ack_encode_status(ESEA_LINK_SYSTEM, ESEA_LINK_COMPONENT, &app->sending, &message, &ack);
    send(app, &message);
    if (heartbeat)
        esea_link_send_heartbeat(app);
    if (info)
        send_info(app);
    if (clock)
        send_clock(app);
}

/* What the host wants, for as long as it says and no longer than we let it. */
static void run_wanted(esea_app_t *app, const esea_link_wanted_t *wanted, uint32_t deadline_ms)
{
    esea_motion_t *const motion = &app->motion;
    const bool on = esea_link_mode(wanted) == 1.0f || esea_link_mode(wanted) == 2.0f;

    if (!on && esea_link_mode(wanted) != 0.0f) { /* NaN, or no mode: not a command */
        esea_count(&motion->refused);
        return;
    }
    if (deadline_ms == 0u)
        deadline_ms = ESEA_DEADLINE_MS;
    if (deadline_ms < ESEA_DEADLINE_LEAST_MS)
        deadline_ms = ESEA_DEADLINE_LEAST_MS;
    if (deadline_ms > ESEA_DEADLINE_MOST_MS)
        deadline_ms = ESEA_DEADLINE_MOST_MS;

    app->port->quiet(true);
    motion->mode_on = on;
    if (!esea_app_event(app, on ? ESEA_EVENT_ON : ESEA_EVENT_OFF)) {
        esea_count(&motion->refused);
    } else if (on) {
        motion->wanted = *wanted;
        motion->deadline_left = esea_ticks(deadline_ms);
    }
    app->port->quiet(false);
}

static void run_message(esea_app_t *app)
{
    esea_link_in_t in;
    esea_link_wanted_t wanted;
    uint32_t task, sequence, deadline_ms;

    app->motion.link_left = esea_ticks(ESEA_LINK_LOST_MS); /* one word: whole, whatever comes between */
    if (esea_link_decode(&app->received, &task, &sequence, &in))
        replay_task(app, task, sequence, &in);
    else if (esea_link_decode_wanted(&app->received, &wanted, &deadline_ms))
        run_wanted(app, &wanted, deadline_ms);
    else if (app->received.msgid == MAVLINK_MSG_ID_COMMAND_LONG)
        run_command(app, &app->received);
    else if (app->received.msgid != MAVLINK_MSG_ID_HEARTBEAT)
        esea_count(&app->unknown_messages); /* of the dialect, but not for the board */
}

void esea_link_receive(esea_app_t *app, uint8_t byte)
{
    switch (mavlink_frame_char_buffer(&app->received, &app->receiving, byte, NULL, NULL)) {
    case MAVLINK_FRAMING_OK:
        run_message(app);
        break;
    case MAVLINK_FRAMING_INCOMPLETE:
        break;
    default:
        /* The parser reports a message that is not in its table as a wrong checksum. */
        if (mavlink_get_msg_entry(app->received.msgid) == NULL)
            esea_count(&app->unknown_messages);
        else
            esea_count(&app->bad_frames);
        break;
    }
}
