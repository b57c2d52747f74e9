/* Frames in, and the main loop.
 *
 * License: MIT. */
#include "app.h"

#include <string.h>

static void replay_task(esea_app_t *app, uint32_t task, uint32_t sequence, const esea_link_in_t *in)
{
    esea_link_out_t out;
    mavlink_message_t message;
    uint32_t ticks;

    if (!esea_app_ask(app, ESEA_EVENT_INPUT)) {
        esea_send_heartbeat(app); /* the answer to every input that is not taken */
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
    ticks = esea_app_measure(app, task, in, &out);
    esea_count(&app->steps);
    esea_link_encode(task, sequence, ticks, &out, &app->sending, &message);
    esea_send(app, &message);
    if (app->steps % ESEA_LINK_HEARTBEAT_EVERY == 0u) {
        esea_app_check_stack(app);
        esea_send_heartbeat(app);
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
    esea_send(app, &message);
    if (heartbeat)
        esea_send_heartbeat(app);
    if (info)
        esea_send_info(app);
    if (clock)
        esea_send_clock(app);
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
            esea_count(&app->unknown_messages);
        else
            esea_count(&app->bad_frames);
        break;
    }
}

/* Tells of the state: now and then, and where it is another. */
static void send_state(esea_app_t *app)
{
    if (app->clock.tick - app->clock.told_tick >= ESEA_LINK_HEARTBEAT_EVERY) {
        app->clock.told_tick = app->clock.tick;
        esea_app_check_stack(app);
        app->told = ESEA_STATE_BOOT; /* so that it is sent */
    }
    /* The answers of a replay tell of it. */
    if (app->told != app->state && app->state != ESEA_STATE_REPLAY)
        esea_send_heartbeat(app);
    app->told = app->state;
}

void esea_app_poll(esea_app_t *app)
{
    uint8_t bytes[64];
    size_t n, i;

    while ((n = app->port->read(bytes, sizeof bytes)) > 0u)
        for (i = 0u; i < n; ++i)
            receive(app, bytes[i]);
    if (app->motion.zeroing_ends)
        esea_app_end_zeroing(app);
    esea_send_runs(app);
    send_state(app);
    app->port->wait();
}
