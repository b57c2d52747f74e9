/* A board inside another program: a library whose clock, drivers and serial line the program drives in
 * lockstep.  Nothing happens by itself, so that a run repeats bit for bit.
 *
 * License: MIT. */
#include <math.h>
#include <string.h>

#include "app.h"
#include "port.h"

#define LINE_BYTES 65536u
#define GUESTS 4u

typedef struct {
    uint8_t bytes[LINE_BYTES];
    size_t count, taken;
} line_t;

static esea_app_t app;
static line_t received, sent;
static uint32_t lost, now;
static float measured[ESEA_LINK_MEASURED + 1u];
static float motors_Nm[ESEA_LINK_AXES + 1u];
static uint32_t trouble_found, times_fed, unique;
static esea_guest_t guests[GUESTS];
static esea_blackbox_t blackbox; /* its memory outlasts the power */
static uint8_t cells[ESEA_STORE_AREAS][16384];
static esea_store_t store;
static bool motor_on, stop_line_open, slower_asked, stack_used_up;

static bool put(line_t *line, const uint8_t *bytes, size_t count)
{
    if (line->taken == line->count)
        line->taken = line->count = 0u;
    if (count > sizeof line->bytes - line->count)
        return false;
    memcpy(line->bytes + line->count, bytes, count);
    line->count += count;
    return true;
}

static size_t take(line_t *line, uint8_t *bytes, size_t capacity)
{
    const size_t left = line->count - line->taken;
    const size_t n = left < capacity ? left : capacity;

    memcpy(bytes, line->bytes + line->taken, n);
    line->taken += n;
    return n;
}

static size_t port_read(uint8_t *bytes, size_t capacity)
{
    return take(&received, bytes, capacity);
}

static void port_write(const uint8_t *bytes, size_t count)
{
    if (!put(&sent, bytes, count))
        lost += (uint32_t)count;
}

static void port_nothing(void)
{
}

static uint32_t port_ticks(void)
{
    return now;
}

static void port_quiet(bool on)
{
    (void)on;
}

static void port_pend(void)
{
    slower_asked = true;
}

static uint32_t port_lost_bytes(void)
{
    return lost;
}

static uint32_t port_stack_peak(void)
{
    return stack_used_up ? 1u : 0u;
}

static void port_sample(float *values)
{
    memcpy(values, measured, ESEA_LINK_MEASURED * sizeof *values);
}

static void port_motor(const float *u_Nm, bool enable)
{
    memcpy(motors_Nm, u_Nm, ESEA_LINK_AXES * sizeof *u_Nm);
    motor_on = enable;
}

static bool port_stop_open(void)
{
    return stop_line_open;
}

static uint32_t port_trouble(void)
{
    const uint32_t found = trouble_found;

    trouble_found = 0u;
    return found;
}

static void port_feed(void)
{
    ++times_fed;
}

static void flash_read(uint32_t area, uint32_t at, void *to, size_t count)
{
    memcpy(to, cells[area] + at, count);
}

static bool flash_write(uint32_t area, uint32_t at, const void *from, size_t count)
{
    const uint8_t *bytes = from;
    size_t i;

    for (i = 0u; i < count; ++i)
        cells[area][at + i] &= bytes[i];
    return true;
}

static bool flash_erase(uint32_t area)
{
    memset(cells[area], 0xFF, sizeof cells[area]);
    return true;
}

/* -- what the program calls -------------------------------------------------------------------- */

void sim_start(void);
void sim_feed(const uint8_t *bytes, size_t count);
size_t sim_take(uint8_t *bytes, size_t capacity);
void sim_poll(void);
void sim_unique(uint32_t number);
uint32_t sim_time_ms(void);
size_t sim_guests(void);
size_t sim_greet(size_t guest, const char *commander, uint8_t *answer);
size_t sim_overhear(size_t guest, const uint8_t *bytes, size_t count, bool last, uint8_t *answer);
void sim_measure(const float *values);
void sim_tick(uint32_t base_ticks, bool slower);
void sim_step(const float *values, uint32_t *words);
void sim_slower(void);
void sim_stop_line(bool open);
void sim_stack(bool used_up);
void sim_fail(uint32_t fault);
void sim_overwrite_state(uint32_t state);
size_t sim_bytes(bool coeffs);
void sim_flip(bool coeffs, size_t byte, uint8_t bits);
float sim_motor_Nm(uint32_t axis);
bool sim_motor_on(void);
uint32_t sim_state(void);
uint32_t sim_fault(void);
void sim_trouble(uint32_t fault);
uint32_t sim_times_fed(void);
uint8_t *sim_flash(uint32_t area);
size_t sim_flash_bytes(void);
bool sim_store_commit(void);
uint32_t sim_armings(void);
uint8_t *sim_blackbox_memory(void);
size_t sim_blackbox_bytes(void);
uint32_t sim_blackbox_fault(void);
uint32_t sim_blackbox_tick(void);
uint32_t sim_blackbox_count(void);
void sim_blackbox_release(void);
bool sim_blackbox_read(uint32_t index, void *record);
bool sim_take_event(uint32_t *state, uint32_t event, const bool *guards);

static const esea_flash_t flash = { sizeof cells[0], flash_read, flash_write, flash_erase, 4u };

/* Power on: every encoder's frame is bad until something is measured. */
void sim_start(void)
{
    static esea_port_t port = {
        .name = ESEA_BOARD_NAME,
        .receive_buffer_bytes = LINE_BYTES,
        .stack_bytes = 1u, /* the program's; not measured */
        .read = port_read,
        .write = port_write,
        .wait = port_nothing,
        .ticks = port_ticks,
        .base_ticks = 1000u,
        .quiet = port_quiet,
        .pend = port_pend,
        .lost_bytes = port_lost_bytes,
        .stack_peak_bytes = port_stack_peak,
        .sample = port_sample,
        .motor = port_motor,
        .stop_open = port_stop_open,
        .trouble = port_trouble,
        .feed = port_feed,
        .blackbox = &blackbox,
        .store = &store,
        .flash = &flash,
    };
    uint32_t i;

    memset(&received, 0, sizeof received);
    memset(&sent, 0, sizeof sent);
    lost = now = 0u;
    motor_on = stop_line_open = slower_asked = stack_used_up = false;
    memset(motors_Nm, 0, sizeof motors_Nm);
    for (i = 0u; i < ESEA_LINK_MEASURED; ++i)
        measured[i] = NAN;
    port.unique = unique;
    esea_board_drivers(&port);
    esea_app_init(&app, &port);
}

/* Of the next start, which is otherwise counted in the flash's cells, whose memory ends with the program. */
void sim_unique(uint32_t number)
{
    unique = number;
}

void sim_feed(const uint8_t *bytes, size_t count)
{
    if (!put(&received, bytes, count))
        lost += (uint32_t)count;
}

size_t sim_take(uint8_t *bytes, size_t capacity)
{
    return take(&sent, bytes, capacity);
}

uint32_t sim_time_ms(void)
{
    return esea_now_ms(&app);
}

void sim_poll(void)
{
    do
        esea_app_poll(&app);
    while (received.taken < received.count);
}

/* Those who come beside the host, by number; `answer` takes 512 bytes. */
size_t sim_guests(void)
{
    return GUESTS;
}

static size_t answered(esea_guest_t *guest, uint8_t *answer)
{
    const size_t count = guest->answered;

    memcpy(answer, guest->answer, count);
    guest->answered = 0u;
    return count;
}

size_t sim_greet(size_t guest, const char *commander, uint8_t *answer)
{
    esea_app_greet(&app, &guests[guest % GUESTS], commander);
    return answered(&guests[guest % GUESTS], answer);
}

size_t sim_overhear(size_t guest, const uint8_t *bytes, size_t count, bool last, uint8_t *answer)
{
    esea_app_overhear(&app, &guests[guest % GUESTS], bytes, count, last);
    return answered(&guests[guest % GUESTS], answer);
}

void sim_measure(const float *values)
{
    memcpy(measured, values, ESEA_LINK_MEASURED * sizeof *values);
}

void sim_slower(void)
{
    if (slower_asked) {
        slower_asked = false;
        esea_app_background(&app);
    }
}

/* The clock goes on by so many base ticks and the last one's interrupt comes: more than one are lost
 * ticks.  `slower`: whether the slower tasks get the processor before the next. */
void sim_tick(uint32_t base_ticks, bool slower)
{
    now += 1000u * base_ticks;
    esea_app_tick(&app);
    if (slower)
        sim_slower();
}

/* A whole base tick: what is measured at it, every task, the main loop.  Then `words` has the values of the
 * runs of all tasks of every tick, of each its inputs before its outputs. */
void sim_step(const float *values, uint32_t *words)
{
    uint32_t number;

    sim_measure(values);
    sim_tick(1u, true);
    sim_poll();
    for (number = 0u; number < ESEA_LINK_TASKS; ++number) {
        const uint32_t inputs = esea_link_inputs(number), outputs = esea_link_signals(number) - 1u - inputs;

        if (esea_link_every(number) != 1u)
            continue;
        memcpy(words, &app.in[number], inputs * sizeof *words);
        words += inputs;
        memcpy(words, &app.out[number], outputs * sizeof *words);
        words += outputs;
    }
}

void sim_stop_line(bool open)
{
    stop_line_open = open;
}

void sim_stack(bool used_up)
{
    stack_used_up = used_up;
}

void sim_fail(uint32_t fault)
{
    esea_app_fail(&app, (ESEA_FAULT)fault);
}

void sim_overwrite_state(uint32_t state)
{
    app.state = (ESEA_STATE)state;
}

/* Memory of the device's C, its coefficients or its state. */
size_t sim_bytes(bool coeffs)
{
    return coeffs ? sizeof app.control.coeffs : sizeof app.control.state;
}

void sim_flip(bool coeffs, size_t byte, uint8_t bits)
{
    uint8_t *const memory = coeffs ? (uint8_t *)&app.control.coeffs : (uint8_t *)&app.control.state;

    if (byte < sim_bytes(coeffs))
        memory[byte] ^= bits;
}

float sim_motor_Nm(uint32_t axis)
{
    return axis < sizeof motors_Nm / sizeof motors_Nm[0] ? motors_Nm[axis] : 0.0f;
}

bool sim_motor_on(void)
{
    return motor_on;
}

uint32_t sim_state(void)
{
    return (uint32_t)app.state;
}

uint32_t sim_fault(void)
{
    return (uint32_t)app.fault;
}

/* What the drivers find, told at the next tick or start. */
void sim_trouble(uint32_t fault)
{
    trouble_found = fault;
}

uint32_t sim_times_fed(void)
{
    return times_fed;
}

/* The flash's cells, an area of 16384 bytes. */
uint8_t *sim_flash(uint32_t area)
{
    return cells[area];
}

size_t sim_flash_bytes(void)
{
    return sizeof cells[0];
}

bool sim_store_commit(void)
{
    return esea_store_commit(&store);
}

uint32_t sim_armings(void)
{
    return store.set.use.armings;
}

/* The memory that a reset leaves as it is; a power cut may not. */
uint8_t *sim_blackbox_memory(void)
{
    return (uint8_t *)&blackbox;
}

size_t sim_blackbox_bytes(void)
{
    return sizeof blackbox;
}

uint32_t sim_blackbox_fault(void)
{
    return blackbox.fault;
}

uint32_t sim_blackbox_tick(void)
{
    return blackbox.tick;
}

uint32_t sim_blackbox_count(void)
{
    return esea_blackbox_count(&blackbox);
}

void sim_blackbox_release(void)
{
    esea_blackbox_release(&blackbox);
}

bool sim_blackbox_read(uint32_t index, void *record)
{
    return esea_blackbox_read(&blackbox, index, record);
}

/* The transition function alone; guards in the order of its struct. */
bool sim_take_event(uint32_t *state, uint32_t event, const bool *guards)
{
    ESEA_STATE held = (ESEA_STATE)*state;
    esea_guards_t given;
    bool taken;

    memcpy(&given, guards, sizeof given);
    taken = esea_machine_take(&held, (ESEA_EVENT)event, &given);
    *state = (uint32_t)held;
    return taken;
}
