/* libFuzzer on the whole application of a drive: bytes, frames and commands over the link, measurements,
 * lost ticks and troubles, from power on or with the motor on.  Whatever comes, the motor is on in a state that
 * drives only, its command is a number within the limit, and a frame with up to three wrong bits changes
 * nothing but the count of bad frames (fewer than four wrong bits a checksum of 16 bits always sees).
 * The device's folder, its number format and the limit are given: see tests/board/test_handwritten_c.py.
 *
 * License: MIT. */
#include "board.c" /* firmware/boards/sim: clock, drivers and line, which are moved from here */

#include <stdio.h>
#include <stdlib.h>

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static const uint8_t *bytes;
static size_t left;
static mavlink_status_t writing;

/* All that a run begins from, but the line, which is empty. */
typedef struct {
    bool there, motor_on;
    esea_app_t app;
    esea_store_t store;
    esea_blackbox_t blackbox;
    uint32_t now;
    float measured[ESEA_LINK_MEASURED + 1u], motor_Nm;
    uint8_t cells[ESEA_STORE_AREAS][sizeof cells[0]];
} beginning_t;

static void hold(bool holds, const char *what)
{
    if (holds)
        return;
    fprintf(stderr, "broken: %s\n", what);
    abort();
}
#define must(what) hold(what, #what)

static uint8_t next(void)
{
    return left > 0u ? (--left, *bytes++) : 0u;
}

/* Any number, or one of those that are most asked for. */
static float number(void)
{
    static const float often[] = { 0.0f, 1.0f, 2.0f, -1.0f, 0.5f, 3.0f, 1e9f, -3e38f, NAN, INFINITY };
    const uint8_t kind = next();
    uint32_t word = 0u, i;
    float value;

    if (kind < sizeof often / sizeof often[0])
        return often[kind];
    if (kind < 128u)
        return (float)kind / 16.0f - 4.0f;
    for (i = 0u; i < 4u; ++i)
        word = word << 8 | next();
    memcpy(&value, &word, sizeof value);
    return value;
}

static void checked_tick(uint32_t ticks, bool slower)
{
    sim_tick(ticks, slower);
    must(motors_Nm[0] >= -LIMIT_NM && motors_Nm[0] <= LIMIT_NM); /* a number, too */
    must(motor_on ? esea_state_drives(app.state) : motors_Nm[0] == 0.0f);
    must(!motor_on || (!stop_line_open && app.fault == ESEA_FAULT_NONE));
}

static void poll(void)
{
    sim_poll();
    sent.taken = sent.count = 0u;
}

static void send(const mavlink_message_t *message)
{
    uint8_t frame[MAVLINK_MAX_PACKET_LEN];

    sim_feed(frame, mavlink_msg_to_send_buffer(frame, message));
}

/* A message of the dialect, whole. */
static void write_message(mavlink_message_t *message)
{
    static const mavlink_msg_entry_t entries[] = MAVLINK_MESSAGE_CRCS;
    const mavlink_msg_entry_t *const entry = &entries[next() % (sizeof entries / sizeof entries[0])];
    uint32_t i;

    memset(message, 0, sizeof *message);
    for (i = 0u; i < entry->max_msg_len; ++i)
        _MAV_PAYLOAD_NON_CONST(message)[i] = (char)next();
    message->msgid = entry->msgid;
    (void)mavlink_finalize_message_buffer(message, 255u, 0u, &writing, entry->min_msg_len, entry->max_msg_len,
            entry->crc_extra);
}

static void write_command(mavlink_message_t *message)
{
    static const uint16_t known[] = { ESEA_LINK_CMD_RESET, ESEA_LINK_CMD_ZERO, ESEA_LINK_CMD_CLEAR,
        ESEA_LINK_CMD_STOP, ESEA_LINK_CMD_RELEASE, MAV_CMD_COMPONENT_ARM_DISARM, MAV_CMD_PREFLIGHT_STORAGE,
        MAV_CMD_SET_MESSAGE_INTERVAL, MAV_CMD_REQUEST_MESSAGE };
    mavlink_command_long_t command;

    memset(&command, 0, sizeof command);
    command.target_system = ESEA_LINK_SYSTEM;
    command.target_component = ESEA_LINK_COMPONENT;
    command.command = known[next() % (sizeof known / sizeof known[0])];
    command.param1 = number();
    command.param2 = number();
    (void)mavlink_msg_command_long_encode_status(255u, 0u, &writing, message, &command);
}

/* Asks for a stream; every other time for one that can be. */
static void write_stream(mavlink_message_t *message)
{
    mavlink_esea_stream_t asked;
    const uint8_t most = (next() & 1u) != 0u ? 4u : 255u;
    uint32_t i;

    memset(&asked, 0, sizeof asked);
    asked.stream = next();
    asked.task = next() % 3u;
    asked.interval = next() % 8u;
    asked.count = next() % most;
    for (i = 0u; i < sizeof asked.signals; ++i)
        asked.signals[i] = next() % most;
    (void)mavlink_msg_esea_stream_encode_status(255u, 0u, &writing, message, &asked);
}

/* Wants what the bytes say, for as long as they say. */
static void write_wanted(mavlink_message_t *message)
{
    mavlink_esea_wanted_t wanted;
    const uint8_t kind = next();

    memset(&wanted, 0, sizeof wanted);
    wanted.mode = kind < 192u ? kind % 3u : kind;
    wanted.tau_desired_Nm = number();
    wanted.theta_desired_rad = number();
    wanted.omega_desired_rad_s = number();
    wanted.deadline_ms = (uint16_t)(next() * 8u);
    wanted.boot = app.boot;
    wanted.time_ms = esea_now_ms(&app) - next() / 16u * 64u;
    (void)mavlink_msg_esea_wanted_encode_status(255u, 0u, &writing, message, &wanted);
}

/* A frame with one to three bits turned, not in what says how long it is. */
static void send_corrupt(void)
{
    static esea_app_t before;
    mavlink_message_t message;
    uint8_t frame[MAVLINK_MAX_PACKET_LEN];
    uint16_t length;
    uint32_t i;
    const uint32_t turns = 1u + next() % 3u;
    uint32_t turned[3];

    poll();
    if (app.reader.count > 0u || app.signing.paired)
        return; /* in the middle of a frame; or any frame is refused */
    write_message(&message);
    length = mavlink_msg_to_send_buffer(frame, &message);
    for (i = 0u; i < turns; ++i) {
        turned[i] = (5u + next() % (length - 5u)) * 8u + next() % 8u;
        if ((i > 0u && turned[i] == turned[0]) || (i > 1u && turned[i] == turned[1]))
            return;
        frame[turned[i] / 8u] ^= (uint8_t)(1u << turned[i] % 8u);
    }
    before = app;
    sim_feed(frame, length);
    poll();
    must(app.bad_frames + app.unknown_messages == before.bad_frames + before.unknown_messages + 1u);
    must(app.state == before.state && app.fault == before.fault && app.steps == before.steps);
    must(memcmp(&app.motion, &before.motion, sizeof app.motion) == 0);
    must(memcmp(&app.control, &before.control, sizeof app.control) == 0);
}

static void start(void)
{
    memset(cells, 0xFF, sizeof cells);
    memset(&blackbox, 0, sizeof blackbox);
    memset(&writing, 0, sizeof writing);
    sim_start();
    poll();
}

/* Before a command, which expires. */
static void send_time(uint32_t age_ms)
{
    mavlink_message_t message;

    (void)mavlink_msg_esea_stamp_pack_status(255u, 0u, &writing, &message, 0u, app.boot, esea_now_ms(&app) - age_ms);
    send(&message);
}

static void command(uint16_t what, float param1)
{
    mavlink_message_t message;

    send_time(0u);
    (void)mavlink_msg_command_long_pack_status(255u, 0u, &writing, &message, ESEA_LINK_SYSTEM, ESEA_LINK_COMPONENT,
            what, 0u, param1, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f);
    send(&message);
    poll();
}

static void want(uint32_t mode, float tau_Nm)
{
    mavlink_message_t message;
    mavlink_esea_wanted_t wanted;

    memset(&wanted, 0, sizeof wanted);
    wanted.mode = mode;
    wanted.tau_desired_Nm = tau_Nm;
    wanted.boot = app.boot;
    wanted.time_ms = esea_now_ms(&app);
    (void)mavlink_msg_esea_wanted_encode_status(255u, 0u, &writing, &message, &wanted);
    send(&message);
    poll();
}

static void pass(uint32_t ticks)
{
    while (ticks-- > 0u) {
        checked_tick(1u, true);
        poll();
    }
}

/* The motor on and making torque. */
static void start_driven(void)
{
    start();
    memset(measured, 0, sizeof measured);
    pass(20u);
    command(ESEA_LINK_CMD_ZERO, 0.0f);
    pass(230u);
    want(0u, 0.0f);
    pass(20u);
    command(MAV_CMD_COMPONENT_ARM_DISARM, 1.0f);
    pass(20u);
    want(1u, 0.5f);
    pass(20u);
    must(app.state == ESEA_STATE_ACTIVE && motor_on && motors_Nm[0] != 0.0f);
}

static void keep(beginning_t *beginning)
{
    beginning->there = true;
    beginning->app = app;
    beginning->store = store;
    beginning->blackbox = blackbox;
    beginning->now = now;
    memcpy(beginning->measured, measured, sizeof measured);
    beginning->motor_Nm = motors_Nm[0];
    beginning->motor_on = motor_on;
    memcpy(beginning->cells, cells, sizeof cells);
}

/* As it was kept, which is done once for all. */
static void begin(bool driven)
{
    static beginning_t beginnings[2];
    beginning_t *const beginning = &beginnings[driven ? 1 : 0];

    if (!beginning->there) {
        if (driven)
            start_driven();
        else
            start();
        keep(beginning);
    }
    app = beginning->app;
    store = beginning->store;
    blackbox = beginning->blackbox;
    now = beginning->now;
    memcpy(measured, beginning->measured, sizeof measured);
    motors_Nm[0] = beginning->motor_Nm;
    motor_on = beginning->motor_on;
    memcpy(cells, beginning->cells, sizeof cells);
    received.taken = received.count = sent.taken = sent.count = 0u;
    lost = trouble_found = 0u;
    stop_line_open = slower_asked = stack_used_up = false;
    memset(&writing, 0, sizeof writing);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    mavlink_message_t message;
    uint32_t i, count;

    bytes = data;
    left = size;
    begin((next() & 1u) != 0u);
    while (left > 0u)
        switch (next() % 12u) {
        case 0:
            for (count = next() % 32u; count-- > 0u;) {
                const uint8_t byte = next();

                sim_feed(&byte, 1u);
            }
            break;
        case 1:
            send_time(next() / 16u * 64u);
            write_message(&message);
            send(&message);
            break;
        case 2:
            send_time(next() / 16u * 64u);
            write_command(&message);
            send(&message);
            break;
        case 3:
            write_stream(&message);
            send(&message);
            break;
        case 4:
        case 5:
            write_wanted(&message);
            send(&message);
            break;
        case 6:
            send_corrupt();
            break;
        case 7:
            for (i = 0u; i < ESEA_LINK_MEASURED; ++i)
                measured[i] = next() < 200u ? (float)(next() * 16u) : number();
            break;
        case 8:
            pass(next() % 32u);
            break;
        case 9:
            checked_tick(1u + next() % 4u, next() % 4u != 0u); /* some are lost, or the slower task gets no time */
            break;
        case 10:
            i = next();
            if (i < 8u)
                sim_trouble(100u + i);
            else
                sim_stop_line(i % 2u != 0u);
            break;
        default:
            poll();
            break;
        }
    pass(1u);
    return 0;
}
