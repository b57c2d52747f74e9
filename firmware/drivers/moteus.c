/* License: MIT. */
#include "moteus.h"

#include <string.h>

#define WRITE 0x00u
#define READ 0x10u
#define REPLY 0x20u
#define INT8 0x00u
#define INT16 0x04u
#define INT32 0x08u
#define FLOAT 0x0Cu
#define WRITE_ERROR 0x30u
#define READ_ERROR 0x31u
#define TO_SERVER 0x40u
#define FROM_SERVER 0x41u
#define POLL_SERVER 0x42u
#define NOP 0x50u

#define MODE 0x000u
#define POSITION 0x001u
#define MOTOR_TEMPERATURE 0x00Au
#define VOLTAGE 0x00Du
#define POSITION_COMMAND 0x020u
#define KP_SCALE 0x023u
#define WATCHDOG 0x027u
#define ILIMIT_SCALE 0x02Bu
#define SLOT_0 0x050u
#define VALIDITY 0x058u
#define COUNTER 0x070u
#define MODEL 0x100u
#define REGISTER_MAP 0x102u
#define FIRST_LIMIT 96.0f /* codes of what limits the torque; below are faults */
#define LAST_LIMIT 103.0f

static const uint32_t NAN_BITS = 0x7FC00000u;

static float from_bits(uint32_t bits)
{
    float value;

    memcpy(&value, &bits, sizeof value);
    return value;
}

static uint8_t *put_float(uint8_t *to, float value)
{
    uint32_t bits, i;

    memcpy(&bits, &value, sizeof bits);
    for (i = 0u; i < 4u; ++i)
        *to++ = (uint8_t)(bits >> (8u * i));
    return to;
}

static uint8_t *put(uint8_t *to, uint32_t kind, uint32_t count, uint32_t first)
{
    *to++ = (uint8_t)(kind | count);
    *to++ = (uint8_t)first;
    return to;
}

static bool is_finite(float x)
{
    return x - x == 0.0f;
}

void esea_moteus_start(esea_moteus_t *drive)
{
    const float none = from_bits(NAN_BITS);
    uint32_t k;

    memset(drive, 0, sizeof *drive);
    drive->mode = drive->output_rev = drive->output_rev_s = drive->torque_Nm = drive->valid = none;
    drive->voltage_V = drive->motor_C = drive->board_C = drive->fault = drive->counter = drive->model = drive->registers = none;
    for (k = 0u; k < ESEA_MOTEUS_SLOTS; ++k)
        drive->slot_rev[k] = none;
}

/* A frame of CAN-FD has 8, 12, 16, 20, 24, 32, 48 or 64 bytes. */
static size_t padded(uint8_t *frame, const uint8_t *end)
{
    static const uint8_t sizes[] = { 8u, 12u, 16u, 20u, 24u, 32u, 48u, 64u };
    const size_t count = (size_t)(end - frame);
    size_t k = 0u;

    while (sizes[k] < count)
        ++k;
    memset(frame + count, (int)NOP, sizes[k] - count);
    return sizes[k];
}

size_t esea_moteus_command(uint8_t *frame, bool on, float torque_Nm, float most_Nm, float watchdog_s)
{
    /* The watchdog's "none" is NaN: a drive that nobody stops. */
    const bool may = on && is_finite(torque_Nm) && is_finite(most_Nm) && watchdog_s > 0.0f && is_finite(watchdog_s);
    uint8_t *at = put(frame, WRITE | INT8, 1u, MODE); /* before all else in a frame */
    uint32_t k;

    *at++ = (uint8_t)(may ? ESEA_MOTEUS_POSITION : ESEA_MOTEUS_STOPPED);
    if (may) {
        at = put_float(put(at, WRITE | FLOAT, 3u, POSITION_COMMAND), from_bits(NAN_BITS));
        at = put_float(put_float(at, 0.0f), torque_Nm);
        at = put_float(put(at, WRITE | FLOAT, 3u, KP_SCALE), 0.0f);
        at = put_float(put_float(at, 0.0f), most_Nm);
        at = put_float(put(at, WRITE | FLOAT, 1u, WATCHDOG), watchdog_s);
        at = put_float(put(at, WRITE | FLOAT, 1u, ILIMIT_SCALE), 0.0f); /* the integral, which kp does not scale */
    }
    at = put(at, READ | INT8, 1u, MODE);
    at = put(at, READ | FLOAT, 3u, POSITION);
    for (k = 0u; k < ESEA_MOTEUS_SLOTS; ++k)
        at = put(at, READ | FLOAT, 1u, SLOT_0 + 2u * k);
    at = put(at, READ | INT8, 1u, VALIDITY);
    at = put(at, READ | INT16, 3u, VOLTAGE);
    at = put(at, READ | INT16, 1u, MOTOR_TEMPERATURE);
    at = put(at, READ | INT32, 1u, COUNTER);
    return padded(frame, at);
}

size_t esea_moteus_ask_version(uint8_t *frame)
{
    uint8_t *at = put(frame, READ | INT32, 3u, 0x80u); /* MODEL, whose low seven bits are 0 */

    *at++ = (uint8_t)(MODEL >> 7u);
    return padded(frame, at);
}

/* -- replies --------------------------------------------------------------------------------------- */

typedef struct {
    const uint8_t *at, *end;
    bool sound;
} reading_t;

static uint32_t take_byte(reading_t *from)
{
    if (from->at >= from->end) {
        from->sound = false;
        return 0u;
    }
    return *from->at++;
}

static uint32_t take_number(reading_t *from)
{
    uint32_t value = 0u, byte = 0x80u, shift;

    for (shift = 0u; (byte & 0x80u) != 0u; shift += 7u) {
        if (shift > 28u) {
            from->sound = false;
            return 0u;
        }
        byte = take_byte(from);
        value |= (byte & 0x7Fu) << shift;
    }
    return value;
}

/* The smallest number of an integer type is NaN. */
static float take_value(reading_t *from, uint32_t kind, float int8, float int16, float int32)
{
    const uint32_t bytes = kind == INT8 ? 1u : kind == INT16 ? 2u : 4u;
    const float scale = kind == INT8 ? int8 : kind == INT16 ? int16 : int32;
    uint32_t bits = 0u, sign = 1u << (8u * bytes - 1u), k;

    for (k = 0u; k < bytes; ++k)
        bits |= take_byte(from) << (8u * k);
    if (kind == FLOAT)
        return from_bits(bits);
    if (bits == sign)
        return from_bits(NAN_BITS);
    return ((bits & sign) != 0u ? -(float)((sign - (bits & (sign - 1u)))) : (float)bits) * scale;
}

/* Where a register's value goes, and what a unit of int8, int16 and int32 is. */
static float *place(esea_moteus_t *drive, uint32_t which, float scale[3])
{
    static const float REV[3] = { 0.01f, 0.0001f, 0.00001f }, REV_S[3] = { 0.1f, 0.00025f, 0.00001f };
    static const float NM[3] = { 0.5f, 0.01f, 0.001f }, VOLT[3] = { 0.5f, 0.1f, 0.001f };
    static const float KELVIN[3] = { 1.0f, 0.1f, 0.001f }, ONE[3] = { 1.0f, 1.0f, 1.0f };
    const uint32_t slot = (which - SLOT_0) / 2u;
    const float *unit = ONE;
    float *to = NULL;

    if (which == MODE)
        to = &drive->mode;
    else if (which == POSITION)
        to = &drive->output_rev, unit = REV;
    else if (which == POSITION + 1u)
        to = &drive->output_rev_s, unit = REV_S;
    else if (which == POSITION + 2u)
        to = &drive->torque_Nm, unit = NM;
    else if (which == MOTOR_TEMPERATURE)
        to = &drive->motor_C, unit = KELVIN;
    else if (which == VOLTAGE)
        to = &drive->voltage_V, unit = VOLT;
    else if (which == VOLTAGE + 1u)
        to = &drive->board_C, unit = KELVIN;
    else if (which == VOLTAGE + 2u)
        to = &drive->fault;
    else if (which >= SLOT_0 && slot < ESEA_MOTEUS_SLOTS && which % 2u == 0u)
        to = &drive->slot_rev[slot], unit = REV;
    else if (which == VALIDITY)
        to = &drive->valid;
    else if (which == COUNTER)
        to = &drive->counter;
    else if (which == MODEL)
        to = &drive->model;
    else if (which == REGISTER_MAP)
        to = &drive->registers;
    memcpy(scale, unit, sizeof ONE);
    return to;
}

static void take_subframe(reading_t *from, esea_moteus_t *drive, bool *told_mode)
{
    const uint32_t head = take_byte(from), kind = head & 0x0Cu;
    uint32_t count = head & 0x03u, which;
    float scale[3];

    if (head == NOP)
        return;
    if (head == WRITE_ERROR || head == READ_ERROR) {
        (void)take_number(from);
        (void)take_number(from);
        ++drive->refused;
        return;
    }
    from->sound = from->sound && (head & 0xF0u) == REPLY;
    if (count == 0u)
        count = take_number(from);
    for (which = take_number(from); from->sound && count > 0u; --count, ++which) {
        float *const to = place(drive, which, scale);
        const float value = take_value(from, kind, scale[0], scale[1], scale[2]);

        if (from->sound && to != NULL)
            *to = value;
        *told_mode = *told_mode || which == MODE;
    }
}

bool esea_moteus_take(esea_moteus_t *drive, const uint8_t *frame, size_t count)
{
    reading_t from = { frame, frame + count, true };
    esea_moteus_t told = *drive;
    bool told_mode = false;

    while (from.sound && from.at < from.end)
        take_subframe(&from, &told, &told_mode);
    if (!from.sound)
        return false;
    if (told_mode)
        ++told.replies;
    *drive = told;
    return true;
}

bool esea_moteus_limits(const esea_moteus_t *drive)
{
    return drive->fault >= FIRST_LIMIT && drive->fault <= LAST_LIMIT;
}

/* -- text ------------------------------------------------------------------------------------------ */

size_t esea_moteus_say(uint8_t *frame, const char *text)
{
    size_t count = strlen(text);

    if (count > ESEA_MOTEUS_FRAME_BYTES - 3u)
        count = ESEA_MOTEUS_FRAME_BYTES - 3u;
    frame[0] = TO_SERVER;
    frame[1] = 1u; /* channel */
    frame[2] = (uint8_t)count;
    memcpy(frame + 3, text, count);
    return padded(frame, frame + 3 + count);
}

size_t esea_moteus_listen(uint8_t *frame)
{
    frame[0] = POLL_SERVER;
    frame[1] = 1u;
    frame[2] = (uint8_t)(ESEA_MOTEUS_FRAME_BYTES - 3u);
    return padded(frame, frame + 3);
}

const char *esea_moteus_text(const uint8_t *frame, size_t count, size_t *length)
{
    if (count < 3u || frame[0] != FROM_SERVER || frame[1] != 1u || (size_t)frame[2] + 3u > count)
        return NULL;
    *length = frame[2];
    return (const char *)frame + 3;
}

/* -- lines of an adapter --------------------------------------------------------------------------- */

static char *put_hex(char *to, uint32_t value, uint32_t digits)
{
    while (digits-- > 0u)
        *to++ = "0123456789abcdef"[value >> (4u * digits) & 15u];
    return to;
}

size_t esea_moteus_line(char *line, uint16_t id, const uint8_t *frame, size_t count)
{
    char *at = line + 9;
    size_t k;

    memcpy(line, "can send ", 9u);
    at = put_hex(at, id, 4u);
    *at++ = ' ';
    for (k = 0u; k < count; ++k)
        at = put_hex(at, frame[k], 2u);
    *at++ = '\n';
    return (size_t)(at - line);
}

static int digit(char c)
{
    if (c >= '0' && c <= '9')
        return c - '0';
    if (c >= 'a' && c <= 'f')
        return c - 'a' + 10;
    return c >= 'A' && c <= 'F' ? c - 'A' + 10 : -1;
}

size_t esea_moteus_heard(const char *line, uint16_t *id, uint8_t *frame)
{
    uint32_t from = 0u, digits = 0u;
    size_t count = 0u;

    if (strncmp(line, "rcv ", 4u) != 0)
        return 0u;
    for (line += 4; digit(*line) >= 0 && digits < 8u; ++line, ++digits)
        from = from << 4u | (uint32_t)digit(*line);
    if (digits == 0u || from > 0xFFFFu || *line++ != ' ')
        return 0u;
    for (; digit(line[0]) >= 0 && digit(line[1]) >= 0; line += 2) {
        if (count == ESEA_MOTEUS_FRAME_BYTES)
            return 0u;
        frame[count++] = (uint8_t)(digit(line[0]) * 16 + digit(line[1]));
    }
    *id = (uint16_t)from;
    return *line == ' ' || *line == '\r' || *line == '\n' || *line == '\0' ? count : 0u;
}
