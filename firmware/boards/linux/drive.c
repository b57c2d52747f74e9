/* License: MIT. */
#include "drive.h"

#include <errno.h>
#include <fcntl.h>
#include <linux/can.h>
#include <linux/can/raw.h>
#include <math.h>
#include <net/if.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <termios.h>
#include <unistd.h>

#include "app.h"
#include "moteus.h"

#if ESEA_LINK_AXES == 1

#define DRIVE_ID 1u
#define SENT_ID (0x8000u | DRIVE_ID) /* from 0 to the drive, with a reply */
#define REPLY_ID (DRIVE_ID << 8u)
#define WATCHDOG_S 0.02f /* a drive that hears nothing for so long lets go */
#define SILENT_TICKS 4u /* one more than the encoders' Blocks bridge */
#define WRONG_TICKS 20u /* in a mode that was not asked for, or limited */
#define PATIENCE_MS 2000
#define TRIES 100u

static esea_moteus_t drive;
static int file = -1;
static bool can, on;
static float turn = 1.0f, most_Nm = 0.0f; /* torque at the drive's output over the motor's; largest there */
static bool own_motor_side; /* slot 2 is the coupling's motor side; else it follows from the rotor */
static bool restarted;      /* the drive, which then forgets whole turns of the rotor */
static float first_fault, last_counter;
static uint32_t seen, taken, silent, longest, wrong, left_out;
static char heard[ESEA_MOTEUS_LINE_BYTES * 2u];
static size_t heard_count;

/* A frame that the adapter does not take whole at once is left out: the next tick has a newer one. */
static bool send_frame(const uint8_t *frame, size_t count)
{
    static char rest[ESEA_MOTEUS_LINE_BYTES];
    static size_t rest_count;
    char line[ESEA_MOTEUS_LINE_BYTES];
    size_t length;
    ssize_t n;

    if (can) {
        struct canfd_frame out;

        memset(&out, 0, sizeof out);
        out.can_id = SENT_ID | CAN_EFF_FLAG;
        out.flags = CANFD_BRS;
        out.len = (uint8_t)count;
        memcpy(out.data, frame, count);
        return write(file, &out, sizeof out) == (ssize_t)sizeof out;
    }
    if (rest_count > 0u) { /* of a line that was cut: its end first */
        n = write(file, rest, rest_count);
        rest_count -= n > 0 ? (size_t)n : 0u;
        memmove(rest, rest + (n > 0 ? n : 0), rest_count);
        if (rest_count > 0u)
            return false;
    }
    length = esea_moteus_line(line, SENT_ID, frame, count);
    n = write(file, line, length);
    if (n > 0 && (size_t)n < length) {
        rest_count = length - (size_t)n;
        memcpy(rest, line + n, rest_count);
    }
    return n > 0;
}

/* A frame of the drive, if one has come; 0: none. */
static size_t next_frame(uint8_t *frame)
{
    uint16_t id = 0u;
    size_t count = 0u;
    ssize_t n;

    if (can) {
        struct canfd_frame in;

        while (read(file, &in, sizeof in) > 0)
            if ((in.can_id & CAN_EFF_MASK) == REPLY_ID && in.len <= ESEA_MOTEUS_FRAME_BYTES) {
                memcpy(frame, in.data, in.len);
                return in.len;
            }
        return 0u;
    }
    for (;;) {
        char *end = memchr(heard, '\n', heard_count);

        if (end == NULL) {
            if (heard_count == sizeof heard - 1u)
                heard_count = 0u; /* no line is as long */
            n = read(file, heard + heard_count, sizeof heard - 1u - heard_count);
            if (n <= 0)
                return 0u;
            heard_count += (size_t)n;
            continue;
        }
        *end = '\0';
        count = esea_moteus_heard(heard, &id, frame);
        heard_count -= (size_t)(end + 1 - heard);
        memmove(heard, end + 1, heard_count);
        if (count > 0u && id == REPLY_ID)
            return count;
    }
}

/* All that has come: the last one counts. */
static void drain(void)
{
    uint8_t frame[ESEA_MOTEUS_FRAME_BYTES];
    size_t count;

    while ((count = next_frame(frame)) > 0u) {
        (void)esea_moteus_take(&drive, frame, count);
        restarted = restarted || drive.counter < last_counter;
        last_counter = drive.counter;
    }
}

static void query(bool enable, float torque_Nm)
{
    uint8_t frame[ESEA_MOTEUS_FRAME_BYTES];
    const size_t count = esea_moteus_command(frame, enable, torque_Nm, most_Nm, WATCHDOG_S);

    drain(); /* nothing old waits while the clock rests */
    if (!send_frame(frame, count))
        esea_count(&left_out);
}

/* -- the port -------------------------------------------------------------------------------------- */

/* A count of `bits` in a turn, and behind it what is wrong with it. */
static void put_count(float *to, float rev, uint32_t bits, bool sound)
{
    const float full = (float)(1u << bits);
    const bool known = fabsf(rev) < 1e6f;
    const float part = known ? rev - (float)(int32_t)rev : 0.0f; /* of a turn, of its sign */

    to[0] = (float)((uint32_t)(int32_t)(part * full + full) % (1u << bits));
    to[1] = !sound ? 64.0f : known ? 0.0f : 32.0f; /* as drivers/hardware.h has them */
}

static bool slot_valid(uint32_t slot)
{
    return drive.valid >= 0.0f && ((uint32_t)drive.valid >> (2u * slot) & 1u) != 0u;
}

static void port_sample(float *measured)
{
    static const uint32_t motor[] = ESEA_LINK_MOTOR_COUNTS, load[] = ESEA_LINK_LOAD_COUNTS;

    drain();
    silent = drive.replies != seen ? 0u : silent + 1u;
    longest = silent > longest ? silent : longest;
    taken += drive.replies != seen;
    seen = drive.replies;
    put_count(&measured[motor[0]], own_motor_side ? drive.slot_rev[2] : drive.output_rev, ESEA_ENCODER_BITS,
            silent == 0u && (!own_motor_side || slot_valid(2u)));
    put_count(&measured[load[0]], drive.slot_rev[1], ESEA_ENCODER_BITS, silent == 0u && slot_valid(1u));
#if ESEA_LINK_GEAR_ENCODERS > 0
    {
        static const uint32_t gear[] = ESEA_LINK_GEAR_COUNTS;

        put_count(&measured[gear[0]], drive.slot_rev[0], ESEA_GEAR_BITS, silent == 0u && slot_valid(0u));
    }
#endif
#ifdef ESEA_LINK_MEASURED_MOTOR_C
    measured[ESEA_LINK_MEASURED_MOTOR_C] = drive.motor_C; /* 0 where no thermistor is configured */
#endif
    if (!on)
        query(false, 0.0f);
}

static void port_motor(const float *u_Nm, bool enable)
{
    on = enable;
    if (!on)
        wrong = 0u;
    query(enable, u_Nm[0] * turn);
}

/* A drive that was away may have forgotten turns of the rotor, also with the motor off. */
static uint32_t port_trouble(void)
{
    if (silent >= SILENT_TICKS)
        return ESEA_FAULT_DRIVE_SILENT;
    if (on) { /* it needs some ticks to begin */
        wrong = drive.mode != (float)ESEA_MOTEUS_POSITION || esea_moteus_limits(&drive) ? wrong + 1u : 0u;
        if (drive.mode == (float)ESEA_MOTEUS_FAULT || drive.mode == (float)ESEA_MOTEUS_TIMEOUT)
            wrong = WRONG_TICKS;
    }
    if (!restarted && wrong < WRONG_TICKS)
        return ESEA_FAULT_NONE;
    first_fault = wrong < WRONG_TICKS ? first_fault : drive.fault; /* a stop clears it in the drive */
    restarted = false;
    wrong = 0u;
    return ESEA_FAULT_DRIVE;
}

void drive_print(FILE *to)
{
    if (file >= 0)
        fprintf(to, "drive: mode %g, fault %g (of the last stop: %g), %.1f V, board %.1f degC, motor %.1f degC\n  %u ticks with a reply, at most %u without in a row, %u frames left out\n",
                (double)drive.mode, (double)drive.fault, (double)first_fault, (double)drive.voltage_V, (double)drive.board_C,
                (double)drive.motor_C, taken, longest, left_out);
}

/* -- before the first tick ------------------------------------------------------------------------- */

static bool open_can(const char *name)
{
    const int yes = 1;
    struct sockaddr_can at;
    struct ifreq named;

    memset(&at, 0, sizeof at);
    memset(&named, 0, sizeof named);
    strncpy(named.ifr_name, name, sizeof named.ifr_name - 1u);
    file = socket(PF_CAN, SOCK_RAW | SOCK_NONBLOCK | SOCK_CLOEXEC, CAN_RAW);
    if (file < 0 || ioctl(file, SIOCGIFINDEX, &named) != 0 ||
        setsockopt(file, SOL_CAN_RAW, CAN_RAW_FD_FRAMES, &yes, sizeof yes) != 0)
        return false;
    at.can_family = AF_CAN;
    at.can_ifindex = named.ifr_ifindex;
    can = true;
    return bind(file, (struct sockaddr *)&at, sizeof at) == 0;
}

static bool open_serial(const char *name)
{
    struct termios settings;

    file = open(name, O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
    if (file < 0 || tcgetattr(file, &settings) != 0)
        return false;
    cfmakeraw(&settings);
    return tcsetattr(file, TCSANOW, &settings) == 0 && tcflush(file, TCIOFLUSH) == 0;
}

/* Waits for a frame; 0: none came in time. */
static size_t await_frame(uint8_t *frame)
{
    struct pollfd ready = { file, POLLIN, 0 };
    size_t count;
    int came;

    while ((count = next_frame(frame)) == 0u) {
        do
            came = poll(&ready, 1u, PATIENCE_MS);
        while (came < 0 && errno == EINTR);
        if (came <= 0)
            return 0u;
    }
    return count;
}

/* A setting by its name, as text of the diagnostic channel; NaN: no answer. */
static float setting(const char *name)
{
    uint8_t frame[ESEA_MOTEUS_FRAME_BYTES];
    char asked[ESEA_MOTEUS_FRAME_BYTES], answer[ESEA_MOTEUS_LINE_BYTES] = "", *end;
    size_t length = 0u, known = 0u, tries;
    float value;

    (void)snprintf(asked, sizeof asked, "conf get %s\n", name);
    (void)send_frame(frame, esea_moteus_say(frame, asked));
    for (tries = 0u; tries < 20u && strchr(answer, '\n') == NULL; ++tries) {
        const char *text;
        size_t count;

        (void)send_frame(frame, esea_moteus_listen(frame));
        count = await_frame(frame);
        if (count == 0u)
            break;
        text = esea_moteus_text(frame, count, &length);
        if (text == NULL || length > sizeof answer - 1u - known)
            continue;
        memcpy(answer + known, text, length);
        known += length;
        answer[known] = '\0';
    }
    value = strtof(answer, &end);
    return end != answer ? value : NAN;
}

static bool refuse(const char *what, const char *remedy)
{
    fprintf(stderr, "%s\n%s\n", what, remedy);
    return false;
}

static bool check_settings(void)
{
    uint8_t frame[ESEA_MOTEUS_FRAME_BYTES];
    char what[160];
    float ratio, mode;
    size_t count, tries = 0u;

    (void)send_frame(frame, esea_moteus_ask_version(frame));
    while (!isfinite(drive.registers)) {
        count = await_frame(frame);
        if (count == 0u || ++tries > TRIES)
            return refuse("No moteus with id 1 answers.", "Check its power, the cable, the adapter, and its id in tview.");
        (void)esea_moteus_take(&drive, frame, count);
    }
    if (drive.registers != (float)ESEA_MOTEUS_REGISTERS) {
        (void)snprintf(what, sizeof what, "The drive's register map is version %g; this program knows version %d.",
                (double)drive.registers, ESEA_MOTEUS_REGISTERS);
        return refuse(what, "Flash a moteus firmware with that version.");
    }
    mode = setting("servo.timeout_mode");
    if (mode != 0.0f) {
        (void)snprintf(what, sizeof what, "servo.timeout_mode is %g: a drive that hears nothing would hold or brake the joint.",
                (double)mode);
        return refuse(what, "In tview: conf set servo.timeout_mode 0, then conf write.");
    }
    ratio = setting("motor_position.rotor_to_output_ratio");
    if (!(fabsf(ratio * ESEA_GEAR_RATIO - 1.0f) <= 0.01f)) {
        (void)snprintf(what, sizeof what, "motor_position.rotor_to_output_ratio is %g; the device file's gear of %g needs %.6f.",
                (double)ratio, (double)ESEA_GEAR_RATIO, 1.0 / (double)ESEA_GEAR_RATIO);
        return refuse(what, "Correct the one that is wrong: in tview with conf set, or in the device file.");
    }
    turn = 1.0f / ratio;
    most_Nm = ESEA_MOTOR_MOST_NM * turn;
    query(false, 0.0f);
    while (drive.replies == 0u && ++tries < 2u * TRIES && (count = await_frame(frame)) > 0u)
        (void)esea_moteus_take(&drive, frame, count);
    if (!slot_valid(0u) || !slot_valid(1u))
        return refuse("The drive's encoder 0 (rotor) or 1 (load side) is not valid.",
                "Configure motor_position.sources in tview; turn the joint by hand and watch both.");
    if (own_motor_side && !slot_valid(2u))
        return refuse("The drive's encoder 2 (motor side of the coupling) is not valid.",
                "Configure motor_position.sources.2, or give --rotor-side: play of the gear then counts as deflection.");
    last_counter = drive.counter;
    seen = drive.replies;
    fprintf(stderr, "drive: moteus, %.1f V; motor side of the coupling from %s\n", (double)drive.voltage_V,
            own_motor_side ? "encoder 2" : "the rotor");
    return true;
}

bool drive_open(esea_port_t *port, const char *address, bool rotor_side)
{
    bool opened = false;

    if (rotor_side && port->store != NULL)
        return refuse("--keep and --rotor-side: the drive forgets whole turns of the rotor when its power goes, so no zero may be kept.",
                "Leave out --keep, or fit an encoder on the motor side of the coupling.");
    own_motor_side = !rotor_side;
    errno = EINVAL;
    esea_moteus_start(&drive);
    if (strncmp(address, "can:", 4) == 0)
        opened = open_can(address + 4);
    else if (strncmp(address, "serial:", 7) == 0)
        opened = open_serial(address + 7);
    if (!opened) {
        fprintf(stderr, "no drive at %s: give serial:FILE or can:INTERFACE (%s)\n", address, strerror(errno));
        return false;
    }
    if (!check_settings())
        return false;
    if (drive.model == (float)ESEA_MOTEUS_EMULATED)
        port->name = "linux-sim"; /* what comes of it is simulated */
    port->sample = port_sample;
    port->motor = port_motor;
    port->trouble = port_trouble;
    return true;
}

#else
bool drive_open(esea_port_t *port, const char *address, bool rotor_side)
{
    (void)port;
    (void)rotor_side;
    fprintf(stderr, "no drive at %s: this device has %u motors, and the driver is for one\n", address, ESEA_LINK_AXES);
    return false;
}

void drive_print(FILE *to)
{
    (void)to;
}
#endif
