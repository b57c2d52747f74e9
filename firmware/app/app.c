/* License: MIT. */
#include "app.h"

#include <string.h>

static void count(uint32_t *counter)
{
    if (*counter != UINT32_MAX)
        ++*counter;
}

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

static void send_heartbeat(esea_app_t *app)
{
    static const uint8_t states[] = {
        [ESEA_MODE_BOOT] = MAV_STATE_BOOT,
        [ESEA_MODE_READY] = MAV_STATE_STANDBY,
        [ESEA_MODE_RUNNING] = MAV_STATE_ACTIVE,
        [ESEA_MODE_FAULT] = MAV_STATE_CRITICAL,
    };
    mavlink_heartbeat_t fields;
    mavlink_message_t message;

    memset(&fields, 0, sizeof fields);
    fields.type = MAV_TYPE_GENERIC;
    fields.autopilot = MAV_AUTOPILOT_INVALID;
    fields.base_mode = MAV_MODE_FLAG_CUSTOM_MODE_ENABLED;
    fields.custom_mode = (uint32_t)app->mode;
    fields.system_status = app->fault == ESEA_FAULT_PROCESSOR ? (uint8_t)MAV_STATE_EMERGENCY : states[app->mode];
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

void esea_app_fail(esea_app_t *app, ESEA_FAULT fault)
{
    /* The first fault is the one to report: later ones may follow from it. */
    if (app->fault == ESEA_FAULT_NONE)
        app->fault = fault;
    app->mode = ESEA_MODE_FAULT;
    send_heartbeat(app);
}

static void check_stack(esea_app_t *app)
{
    if (app->fault == ESEA_FAULT_NONE && app->port->stack_peak_bytes() >= app->port->stack_bytes)
        esea_app_fail(app, ESEA_FAULT_STACK_EXHAUSTED);
}

/* Timer ticks of a step, those of measuring it included. */
static uint32_t measure(esea_app_t *app, uint32_t task, const esea_link_in_t *in, esea_link_out_t *out)
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

/* Initial state of everything but the link; false when a default is refused. */
static bool reset(esea_app_t *app)
{
    esea_link_in_t in;
    esea_link_out_t out;

    app->mode = ESEA_MODE_BOOT;
    app->fault = ESEA_FAULT_NONE;
    app->steps = 0u;
    app->sequence_gaps = 0u;
    memset(app->started, 0, sizeof app->started);
    app->released = false;
    if (esea_link_init(&app->control) != 0u) {
        esea_app_fail(app, ESEA_FAULT_PREPARE_REFUSED);
        return false;
    }
    memset(&in, 0, sizeof in);
    app->empty_ticks = measure(app, ESEA_LINK_TASKS, &in, &out);
    app->mode = ESEA_MODE_READY;
    check_stack(app);
    return app->fault == ESEA_FAULT_NONE;
}

static void run_task(esea_app_t *app, uint32_t task, uint32_t sequence, const esea_link_in_t *in)
{
    esea_link_out_t out;
    mavlink_message_t message;
    uint32_t ticks;

    if (app->fault != ESEA_FAULT_NONE) {
        send_heartbeat(app); /* the answer to every input while a fault is latched */
        return;
    }
    if (app->started[task] && sequence != app->next_tick[task])
        count(&app->sequence_gaps);
    app->started[task] = true;
    app->next_tick[task] = sequence + esea_link_every(task);
    app->mode = ESEA_MODE_RUNNING;

    /* Once a tick, before its first task: a second release would show what that task just wrote. */
    if (!app->released || sequence != app->released_tick)
        esea_link_release(&app->control, sequence);
    app->released = true;
    app->released_tick = sequence;
    ticks = measure(app, task, in, &out);
    count(&app->steps);
    esea_link_encode(task, sequence, ticks, &out, &app->sending, &message);
    send(app, &message);
    if (app->steps % ESEA_LINK_HEARTBEAT_EVERY == 0u) {
        check_stack(app);
        send_heartbeat(app);
    }
}

static void run_command(esea_app_t *app, const mavlink_message_t *received)
{
    mavlink_command_long_t command;
    mavlink_command_ack_t ack;
    mavlink_message_t message;
    bool heartbeat = false, info = false;

    mavlink_msg_command_long_decode(received, &command);
    if ((command.target_system != 0u && command.target_system != ESEA_LINK_SYSTEM) ||
        (command.target_component != 0u && command.target_component != ESEA_LINK_COMPONENT))
        return;

    memset(&ack, 0, sizeof ack);
    ack.command = command.command;
    ack.target_system = received->sysid;
    ack.target_component = received->compid;
    switch (command.command) {
    case ESEA_LINK_CMD_RESET:
        ack.result = reset(app) ? MAV_RESULT_ACCEPTED : MAV_RESULT_FAILED;
        break;
    case MAV_CMD_REQUEST_MESSAGE:
        /* Message ids are exact in a float; NaN equals none. */
        heartbeat = command.param1 == (float)MAVLINK_MSG_ID_HEARTBEAT;
        info = command.param1 == (float)MAVLINK_MSG_ID_ESEA_INFO;
        ack.result = heartbeat || info ? MAV_RESULT_ACCEPTED : MAV_RESULT_DENIED;
        break;
    default:
        ack.result = MAV_RESULT_UNSUPPORTED;
        break;
    }
    (void)mavlink_msg_command_ack_encode_status(ESEA_LINK_SYSTEM, ESEA_LINK_COMPONENT, &app->sending, &message, &ack);
    send(app, &message);
    if (heartbeat)
        send_heartbeat(app);
    if (info)
        send_info(app);
}

static void run_message(esea_app_t *app)
{
    esea_link_in_t in;
    uint32_t task, sequence;

    if (esea_link_decode(&app->received, &task, &sequence, &in))
        run_task(app, task, sequence, &in);
    else if (app->received.msgid == MAVLINK_MSG_ID_COMMAND_LONG)
        run_command(app, &app->received);
    else if (app->received.msgid != MAVLINK_MSG_ID_HEARTBEAT)
        count(&app->unknown_messages); /* of the dialect, but not for the board */
}

static void receive(esea_app_t *app, uint8_t byte)
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
            count(&app->unknown_messages);
        else
            count(&app->bad_frames);
        break;
    }
}

void esea_app_init(esea_app_t *app, const esea_port_t *port)
{
    memset(app, 0, sizeof *app);
    app->port = port;
    if (reset(app))
        send_heartbeat(app);
}

void esea_app_poll(esea_app_t *app)
{
    uint8_t bytes[64];
    size_t n, i;

    while ((n = app->port->read(bytes, sizeof bytes)) > 0u)
        for (i = 0u; i < n; ++i)
            receive(app, bytes[i]);
    app->port->wait();
}
