/* Frames in, and the main loop.
 *
 * License: MIT. */
#include "app.h"

#include <string.h>

#define MOST_AT_ONCE 8192u /* bytes, before anything is sent */

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

    if (!(interval_us <= 1e9f)) /* NaN too */
        return MAV_RESULT_DENIED;
    if (id == (float)MAVLINK_MSG_ID_ESEA_KEY) {
        app->key.interval = interval_us > 0.0f ? esea_ticks((uint32_t)interval_us / 1000u) : 0u;
        esea_key_ask(app);
        return MAV_RESULT_ACCEPTED;
    }
    for (number = 0u; number < ESEA_LINK_TASKS; ++number)
        for (side = 0u; side < ESEA_SIDES; ++side) {
            const uint32_t every = esea_link_every(number);
            const uint32_t ticks = interval_us > 0.0f ? (uint32_t)interval_us / ESEA_LINK_TICK_US : 0u;

            if (id != (float)esea_link_message(number, side))
                continue;
            app->tasks[number].interval[side] =
                    interval_us > 0.0f && ticks == 0u ? every : (ticks + every - 1u) / every * every;
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
        /* Sent again, as who waits for STOPPED does, it is not the second stop, which switches off at once. */
        if (command->confirmation > 0u && app->state == ESEA_STATE_STOPPING)
            return MAV_RESULT_ACCEPTED;
        return ask(app, ESEA_EVENT_STOP);
    case ESEA_LINK_CMD_RELEASE:
        return ask(app, ESEA_EVENT_RELEASE);
    case MAV_CMD_COMPONENT_ARM_DISARM:
        /* Anything but a clear yes switches off. */
        return ask(app, command->param1 == 1.0f ? ESEA_EVENT_ARM : ESEA_EVENT_DISARM);
    case MAV_CMD_PREFLIGHT_STORAGE:
        return esea_parameters_storage(app, command->param1);
    case MAV_CMD_SET_MESSAGE_INTERVAL:
        return set_interval(app, command->param1, command->param2);
    default:
        return MAV_RESULT_UNSUPPORTED;
    }
}

/* Message ids are exact in a float; NaN equals none. */
static bool can_be_asked(float id)
{
    return id == (float)MAVLINK_MSG_ID_HEARTBEAT || id == (float)MAVLINK_MSG_ID_ESEA_INFO ||
           id == (float)MAVLINK_MSG_ID_ESEA_CLOCK || id == (float)MAVLINK_MSG_ID_ESEA_TRAFFIC ||
           id == (float)MAVLINK_MSG_ID_ESEA_KEPT || id == (float)MAVLINK_MSG_ID_ESEA_LIFE ||
           id == (float)MAVLINK_MSG_ID_STATUSTEXT;
}

/* `number`: which of several there are. */
static void send_asked(esea_app_t *app, uint32_t id, float number)
{
    if (id == MAVLINK_MSG_ID_HEARTBEAT)
        esea_send_heartbeat(app);
    else if (id == MAVLINK_MSG_ID_ESEA_INFO)
        esea_send_info(app);
    else if (id == MAVLINK_MSG_ID_ESEA_CLOCK)
        esea_send_clock(app);
    else if (id == MAVLINK_MSG_ID_ESEA_KEPT)
        esea_send_kept(app, MAV_RESULT_ACCEPTED);
    else if (id == MAVLINK_MSG_ID_STATUSTEXT)
        esea_parameters_tell(app);
    else if (id == MAVLINK_MSG_ID_ESEA_LIFE)
        esea_send_life(app, number >= 0.0f && number < 255.0f ? (uint32_t)number : 0u, MAV_RESULT_ACCEPTED);
    else
        esea_send_traffic(app);
}

static void run_command(esea_app_t *app, const mavlink_message_t *received)
{
    mavlink_command_long_t command;
    uint8_t result;

    mavlink_msg_command_long_decode(received, &command);
    /* A stop is taken whoever it is for. */
    if (command.command != ESEA_LINK_CMD_STOP && !esea_meant(command.target_system, command.target_component))
        return;
    if (command.command == MAV_CMD_REQUEST_MESSAGE)
        result = (uint8_t)(can_be_asked(command.param1) ? MAV_RESULT_ACCEPTED : MAV_RESULT_DENIED);
    else
        result = do_command(app, &command);
    esea_send_ack(app, received, command.command, result, false);
    if (command.command == MAV_CMD_REQUEST_MESSAGE && result == MAV_RESULT_ACCEPTED)
        send_asked(app, (uint32_t)command.param1, command.param2);
    if (result == MAV_RESULT_TEMPORARILY_REJECTED)
        esea_send_text(app, MAV_SEVERITY_WARNING, "command refused in state ",
                esea_link_state_name((uint32_t)app->state));
}

/* The encoders that are fitted, by their serial numbers: with others the zeros are others, so it starts afresh. */
static uint8_t name_encoders(esea_app_t *app, const mavlink_message_t *message)
{
    mavlink_esea_kept_t asked;
    uint32_t serials[ESEA_STORE_ENCODERS];
    uint8_t result;

    mavlink_msg_esea_kept_decode(message, &asked);
    memcpy(serials, asked.serial, sizeof serials);
    result = esea_keep_may_fit(app, serials);
    if (result != MAV_RESULT_ACCEPTED)
        return result;
    if (!esea_app_ask(app, ESEA_EVENT_RESET))
        return MAV_RESULT_TEMPORARILY_REJECTED;
    esea_keep_fitted(app, serials);
    return (uint8_t)(esea_app_reset(app) ? MAV_RESULT_ACCEPTED : MAV_RESULT_FAILED);
}

static void name_coupling(esea_app_t *app, const mavlink_message_t *message)
{
    const uint32_t coupling = mavlink_msg_esea_life_get_number(message);

    esea_send_life(app, coupling, esea_keep_coupling(app, coupling, mavlink_msg_esea_life_get_serial(message)));
}

/* Whether a time is of this start and not long past.  Only that keeps the link: a line may hold back old frames. */
static bool in_time(esea_app_t *app, uint32_t boot, uint32_t time_ms)
{
    const uint32_t past_ms = esea_now_ms(app) - time_ms; /* beyond half of the range: still to come */

    if (boot != app->boot || (past_ms > ESEA_COMMAND_AGE_MS && 0u - past_ms > ESEA_COMMAND_AGE_MS))
        return false;
    app->motion.link_left = esea_ticks(ESEA_LINK_LOST_MS); /* one word: whole, whatever comes between */
    return true;
}

/* What may move something, or permit more, is only taken soon after it was said: it may have waited anywhere.  Not
 * so what switches off, and what only asks. */
static bool expires(const mavlink_message_t *message)
{
    mavlink_command_long_t command;

    switch (message->msgid) {
    case MAVLINK_MSG_ID_PARAM_SET:
        return esea_meant(mavlink_msg_param_set_get_target_system(message),
                mavlink_msg_param_set_get_target_component(message));
    case MAVLINK_MSG_ID_SETUP_SIGNING:
        return esea_meant(mavlink_msg_setup_signing_get_target_system(message),
                mavlink_msg_setup_signing_get_target_component(message));
    case MAVLINK_MSG_ID_ESEA_KEPT:
    case MAVLINK_MSG_ID_ESEA_LIFE:
        return true;
    case MAVLINK_MSG_ID_ESEA_BLACKBOX:
        return mavlink_msg_esea_blackbox_get_records(message) == UINT8_MAX;
    case MAVLINK_MSG_ID_COMMAND_LONG:
        break;
    default:
        return false;
    }
    mavlink_msg_command_long_decode(message, &command);
    if (!esea_meant(command.target_system, command.target_component))
        return false;
    switch (command.command) {
    case ESEA_LINK_CMD_STOP:
    case MAV_CMD_SET_MESSAGE_INTERVAL:
    case MAV_CMD_REQUEST_MESSAGE:
        return false;
    case MAV_CMD_COMPONENT_ARM_DISARM:
        return command.param1 == 1.0f;
    default:
        return true;
    }
}

static void refuse_late(esea_app_t *app, const mavlink_message_t *message, bool timed)
{
    esea_count(&app->expired);
    esea_refuse(app, message, timed ? "too late, or of another start" : "without the board's time", true);
}

/* A message of the board's time is for the frame behind it. */
static void take_stamp(esea_app_t *app, const mavlink_message_t *message)
{
    mavlink_esea_stamp_t fields;

    mavlink_msg_esea_stamp_decode(message, &fields);
    app->stamp.there = true;
    app->stamp.system = message->sysid;
    app->stamp.component = message->compid;
    app->stamp.sequence = (uint8_t)(message->seq + 1u);
    app->stamp.boot = fields.boot;
    app->stamp.time_ms = fields.time_ms;
}

/* Whether there is a time for this frame; once. */
static bool stamped(esea_app_t *app, const mavlink_message_t *message)
{
    esea_stamp_t *const stamp = &app->stamp;

    if (!stamp->there || message->sysid != stamp->system || message->compid != stamp->component)
        return false;
    stamp->there = false;
    return message->seq == stamp->sequence;
}

/* What the host wants, for as long as it says and no longer than we let it. */
static void run_wanted(esea_app_t *app, const esea_link_wanted_t *wanted, uint32_t deadline_ms)
{
    esea_motion_t *const motion = &app->motion;
    const bool on = wanted->mode != 0u;

    if (wanted->mode > 2u) { /* no mode: not a command */
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

/* What changes nothing, and so needs no signature; false when it is something else. */
static bool run_question(esea_app_t *app, const mavlink_message_t *message)
{
    mavlink_timesync_t time;

    switch (message->msgid) {
    case MAVLINK_MSG_ID_HEARTBEAT:
        return true;
    case MAVLINK_MSG_ID_ESEA_STAMP: /* of another's frame, or a question */
        if (mavlink_msg_esea_stamp_get_boot(message) == 0u)
            esea_send_stamp(app);
        return true;
    case MAVLINK_MSG_ID_TIMESYNC:
        /* Decoded whole: the getters of its 64-bit fields would read them where they stand, not aligned. */
        mavlink_msg_timesync_decode(message, &time);
        if (time.tc1 == 0)
            esea_send_time(app, time.ts1);
        return true;
    case MAVLINK_MSG_ID_ESEA_BLACKBOX:
        esea_send_blackbox(app, mavlink_msg_esea_blackbox_get_first(message));
        return true;
    case MAVLINK_MSG_ID_PARAM_REQUEST_READ:
        esea_parameters_read(app, message);
        return true;
    case MAVLINK_MSG_ID_PARAM_REQUEST_LIST:
        if (esea_meant(mavlink_msg_param_request_list_get_target_system(message),
                    mavlink_msg_param_request_list_get_target_component(message)))
            esea_parameters_list(app);
        return true;
    default:
        return false;
    }
}

/* Only by who may command. */
static bool releases_blackbox(const esea_app_t *app, const mavlink_message_t *message)
{
    return message->msgid == MAVLINK_MSG_ID_ESEA_BLACKBOX && app->port->blackbox != NULL &&
           mavlink_msg_esea_blackbox_get_records(message) == UINT8_MAX;
}

static void release_blackbox(esea_app_t *app)
{
    app->port->quiet(true);
    esea_blackbox_release(app->port->blackbox);
    app->port->quiet(false);
    esea_send_blackbox(app, 0u);
}

static void run_message(esea_app_t *app)
{
    const mavlink_message_t *const message = &app->reader.message;
    esea_link_in_t in;
    esea_link_wanted_t wanted;
    uint32_t task, sequence, deadline_ms, boot, time_ms;
    const bool timed = stamped(app, message);
    const bool prompt = timed && in_time(app, app->stamp.boot, app->stamp.time_ms);

    if (esea_link_decode(message, &task, &sequence, &in))
        replay_task(app, task, sequence, &in);
    else if (esea_link_decode_wanted(message, &wanted, &deadline_ms, &boot, &time_ms)) {
        if (in_time(app, boot, time_ms) || wanted.mode == 0u)
            run_wanted(app, &wanted, deadline_ms);
        else
            refuse_late(app, message, boot != 0u);
    } else if (expires(message) && !prompt)
        refuse_late(app, message, timed);
    else if (message->msgid == MAVLINK_MSG_ID_ESEA_STAMP && mavlink_msg_esea_stamp_get_boot(message) != 0u)
        take_stamp(app, message);
    else if (message->msgid == MAVLINK_MSG_ID_COMMAND_LONG)
        run_command(app, message);
    else if (message->msgid == MAVLINK_MSG_ID_ESEA_STREAM)
        esea_streams_choose(app, message);
    else if (message->msgid == MAVLINK_MSG_ID_PARAM_SET)
        esea_parameters_set(app, message);
    else if (message->msgid == MAVLINK_MSG_ID_SETUP_SIGNING)
        esea_signing_setup(app, message);
    else if (message->msgid == MAVLINK_MSG_ID_ESEA_KEPT)
        esea_send_kept(app, name_encoders(app, message));
    else if (message->msgid == MAVLINK_MSG_ID_ESEA_LIFE)
        name_coupling(app, message);
    else if (releases_blackbox(app, message))
        release_blackbox(app);
    else if (!run_question(app, message))
        esea_count(&app->unknown_messages); /* of the dialect, but not for the board */
}

static bool is_command(const mavlink_message_t *message, uint16_t command)
{
    return message->msgid == MAVLINK_MSG_ID_COMMAND_LONG && mavlink_msg_command_long_get_command(message) == command;
}

/* A frame whose signature is missing or not good, to a board that asks for one: a stop is taken all the
 * same, and questions are answered; none keeps the link alive. */
static void run_stranger(esea_app_t *app)
{
    const mavlink_message_t *const message = &app->reader.message;

    if (is_command(message, ESEA_LINK_CMD_STOP) || is_command(message, MAV_CMD_REQUEST_MESSAGE))
        run_command(app, message);
    else if (!run_question(app, message))
        esea_signing_refuse(app, message);
}

static void run_frames(esea_app_t *app)
{
    ESEA_READ found;

    while ((found = esea_reader_next(&app->reader)) != ESEA_READ_NOTHING)
        if (found == ESEA_READ_FRAME && esea_signing_good(app, &app->reader.message))
            run_message(app);
        else if (found == ESEA_READ_FRAME)
            run_stranger(app);
        else if (mavlink_get_msg_entry(app->reader.message.msgid) == NULL)
            esea_count(&app->unknown_messages); /* the parser reports it as a wrong checksum */
        else
            esea_count(&app->bad_frames);
}

/* Answers of these are the guest's, by a count of their own. */
static void turn_to(esea_app_t *app, esea_guest_t *guest, bool on)
{
    const mavlink_status_t other = app->sending;

    app->guest = on ? guest : NULL;
    app->sending = guest->sending;
    guest->sending = other;
}

void esea_app_greet(esea_app_t *app, esea_guest_t *guest, const char *commander)
{
    memset(guest, 0, sizeof *guest);
    turn_to(app, guest, true);
    esea_send_heartbeat(app);
    esea_send_text(app, MAV_SEVERITY_WARNING, "this board is commanded by ", commander);
    esea_send_text(app, MAV_SEVERITY_WARNING, "from others it takes a stop only", "");
    turn_to(app, guest, false);
}

static void run_guest(esea_app_t *app, esea_guest_t *guest)
{
    ESEA_READ found;

    while ((found = esea_reader_next(&guest->reader)) != ESEA_READ_NOTHING)
        if (found == ESEA_READ_FRAME && is_command(&guest->reader.message, ESEA_LINK_CMD_STOP))
            run_command(app, &guest->reader.message);
}

void esea_app_overhear(esea_app_t *app, esea_guest_t *guest, const uint8_t *bytes, size_t count, bool last)
{
    const uint32_t now_ms = esea_now_ms(app);
    size_t i;

    turn_to(app, guest, true);
    if (count > 0u)
        guest->heard_ms = now_ms;
    for (i = 0u; i < count; ++i) {
        esea_reader_put(&guest->reader, bytes[i]);
        run_guest(app, guest);
    }
    while (esea_reader_pauses(&guest->reader, last ? UINT32_MAX : now_ms - guest->heard_ms))
        run_guest(app, guest);
    turn_to(app, guest, false);
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
    if (app->fault != app->fault_told && app->fault != ESEA_FAULT_NONE)
        esea_send_text(app, MAV_SEVERITY_CRITICAL, "fault ", esea_link_fault_name((uint32_t)app->fault));
    app->fault_told = app->fault;
    if (app->motion.not_armed)
        esea_send_text(app, MAV_SEVERITY_WARNING, "not armed: a limit acts, or the drive still moves", "");
    app->motion.not_armed = false;
}

static void receive_all(esea_app_t *app)
{
    uint8_t bytes[64];
    size_t n, i, all = 0u;

    /* Who sends without end does not keep the rest from being done. */
    while (all < MOST_AT_ONCE && (n = app->port->read(bytes, sizeof bytes)) > 0u) {
        app->heard_ms = esea_now_ms(app);
        all += n;
        for (i = 0u; i < n; ++i) {
            esea_reader_put(&app->reader, bytes[i]);
            run_frames(app);
        }
    }
    while (all == 0u && esea_reader_pauses(&app->reader, esea_now_ms(app) - app->heard_ms))
        run_frames(app);
}

static bool room(const esea_app_t *app)
{
    return app->port->room == NULL || app->port->room();
}

/* What has been received is looked at after each message: a line that is full makes nobody wait whose
 * command has come. */
static void send_all(esea_app_t *app)
{
    uint32_t i;

    for (i = 0u; i < ESEA_RUNS_KEPT && room(app) && esea_send_runs(app); ++i)
        receive_all(app);
    for (i = 0u; i < ESEA_LINK_STREAMS; ++i)
        if (room(app) && esea_streams_send(app, i))
            receive_all(app);
    if (room(app) && esea_key_send(app))
        receive_all(app);
}

void esea_app_poll(esea_app_t *app)
{
    receive_all(app);
    if (app->motion.zeroing_ends)
        esea_app_end_zeroing(app);
    esea_keep_up(app);
    esea_signing_up(app);
    send_all(app);
    send_state(app);
    if (!room(app) || (!esea_parameters_send(app) && !esea_streams_wait(app) && !app->key.waits))
        app->port->wait();
}
