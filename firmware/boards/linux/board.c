/* A computer with Linux as a board, one program in one thread: a tick is taken where a microcontroller's
 * interrupt would come, between two instructions that read the line, write it, or wait.
 *
 *   PROGRAM [ADDRESS] [--drive ADDRESS [--rotor-side]] [--keep FILE] [--priority N]
 *
 * ADDRESS  tcp:PORT or tcp:HOST:PORT (this computer alone unless HOST says otherwise), serial:FILE[:BAUD], pty;
 *          without one: frames on standard input and output and no own clock, so that it only replays
 * --drive  serial:FILE (an fdcanusb adapter) or can:INTERFACE: a moteus drive with the encoders of the joint
 * --rotor-side  no encoder on the motor side of the coupling: its angle follows from the rotor's
 * --keep   file for what outlasts the power, and the black box, which so survives the program
 * --priority  of SCHED_FIFO, 80 if not given; 0: that of any other program
 *
 * SIGUSR1 prints how late it woke up, SIGTERM and SIGINT end it.
 *
 * License: MIT. */
#include <errno.h>
#include <poll.h>
#include <sched.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/timerfd.h>
#include <time.h>
#include <unistd.h>

#include "app.h"
#include "drive.h"
#include "guests.h"
#include "line.h"
#include "port.h"

#define AREA_BYTES 16384u
#define BINS 22u /* the last one: 1 s and more */
#define STACK_TOUCHED 65536u
#define QUEUE_BYTES 4096u /* answers and states; telemetry waits in the application */
#define AT_ONCE 4u /* who come between two ticks */
#define PATIENCE_US (ESEA_LINK_LOST_MS * 1000u)

typedef struct {
    uint8_t cells[ESEA_STORE_AREAS][AREA_BYTES];
    esea_blackbox_t blackbox;
} kept_t;

static esea_app_t app;
static esea_store_t store;
static kept_t *kept;
static line_t line;
static int timer = -1; /* none: no own clock */
static bool in_tick, held_off, background_asked;
static volatile sig_atomic_t ends, asked;
static uint64_t due_us, woke_us; /* when the present tick was to come, and when it did */
static uint32_t lateness[BINS], latest_us, ticks_lost, bytes_lost;
static uint8_t queue[QUEUE_BYTES]; /* what the line has not taken; whole messages but for the first */
static size_t queued;
static uint64_t taken_us; /* when it took something last */
static const char *scheduling = "any other program's", *locked = "not locked";

static uint64_t now_us(void)
{
    struct timespec now;

    (void)clock_gettime(CLOCK_MONOTONIC, &now);
    return (uint64_t)now.tv_sec * 1000000u + (uint64_t)now.tv_nsec / 1000u;
}

static void print_lateness(void)
{
    uint32_t k, all = 0u;

    for (k = 0u; k < BINS; ++k)
        all += lateness[k];
    fprintf(stderr, "woke up late, microseconds: %u ticks, %u lost, latest %u; priority %s, memory %s\n", all,
            ticks_lost, latest_us, scheduling, locked);
    for (k = 0u; k < BINS; ++k)
        if (lateness[k] > 0u)
            fprintf(stderr, "  %s %7u: %u\n", k + 1u < BINS ? "< " : ">=", 1u << (k + 1u < BINS ? k : k - 1u), lateness[k]);
    drive_print(stderr);
    fflush(stderr);
}

static void count_lateness(uint64_t late_us)
{
    const uint32_t late = late_us < UINT32_MAX ? (uint32_t)late_us : UINT32_MAX;
    uint32_t bin = 0u;

    while (bin + 1u < BINS && late >= 1u << bin)
        ++bin;
    esea_count(&lateness[bin]);
    if (late > latest_us)
        latest_us = late;
}

/* The tick that is due, if one is; those that nobody took are lost, and the application counts them. */
static void take_tick(void)
{
    uint64_t passed;

    if (timer < 0 || in_tick || held_off || read(timer, &passed, sizeof passed) != (ssize_t)sizeof passed)
        return;
    in_tick = true;
    due_us += ESEA_LINK_TICK_US;
    woke_us = now_us();
    count_lateness(woke_us > due_us ? woke_us - due_us : 0u); /* for the first that was due */
    due_us += (passed - 1u) * ESEA_LINK_TICK_US;
    ticks_lost += (uint32_t)passed - 1u;
    esea_app_tick(&app);
    in_tick = false;
    if (background_asked) {
        background_asked = false;
        esea_app_background(&app);
    }
}

/* Until a tick is due, or the line has something to take or to give; no longer than `most_ms`. */
static void attend(bool to_read, bool to_write, int most_ms)
{
    struct pollfd files[3];
    const nfds_t count = line_files(&line, to_read, to_write, files);

    files[count].fd = held_off || in_tick ? -1 : timer; /* below 0: left out */
    files[count].events = POLLIN;
    (void)poll(files, count + 1u, most_ms);
    take_tick();
    if (asked) {
        asked = 0;
        print_lateness();
    }
}

static size_t port_read(uint8_t *bytes, size_t capacity)
{
    take_tick();
    return line_read(&line, bytes, capacity);
}

/* Gives the line what it takes of what waits; a host that takes nothing for a second is gone. */
static void give(void)
{
    size_t n;

    if (line_gone(&line))
        queued = 0u;
    if (queued == 0u)
        return;
    n = line_write(&line, queue, queued);
    queued -= n;
    if (n > 0u) {
        memmove(queue, queue + n, queued);
        taken_us = now_us();
    } else if (now_us() - taken_us > PATIENCE_US) {
        line_deaf(&line);
        bytes_lost += (uint32_t)queued;
        queued = 0u;
    }
}

static bool port_room(void)
{
    give();
    return queued == 0u;
}

/* On standard output waits for whoever takes it; a line with a clock on it makes nobody wait: what it does not take
 * at once is queued, and a message that finds no room there is left out, whole. */
static void port_write(const uint8_t *bytes, size_t count)
{
    size_t n;

    if (line_live(&line)) {
        if (port_room())
            taken_us = now_us();
        n = queued == 0u ? line_write(&line, bytes, count) : 0u;
        if (count - n > sizeof queue - queued || line_gone(&line)) {
            bytes_lost += (uint32_t)(count - n);
            return;
        }
        memcpy(queue + queued, bytes + n, count - n);
        queued += count - n;
        return;
    }
    for (; count > 0u; bytes += n, count -= n) {
        n = line_write(&line, bytes, count);
        if (line_gone(&line)) {
            bytes_lost += (uint32_t)count;
            return;
        }
        if (n < count)
            attend(false, true, 10);
    }
}

static void port_wait(void)
{
    uint32_t i;
    int other;

    attend(true, queued > 0u, -1);
    give(); /* first: what waited for one host is not for the next */
    for (i = 0u; i < AT_ONCE && (other = line_accept(&line)) >= 0; ++i) {
        guests_admit(&app, other, line.host, now_us());
        take_tick();
    }
    for (i = 0u; i < GUESTS_MOST; ++i) {
        guests_attend(&app, i, now_us());
        take_tick();
    }
}

/* Counts from when the tick was to come, so that a late one is not a lost one. */
static uint32_t port_ticks(void)
{
    return timer < 0 ? 0u : (uint32_t)(due_us + (now_us() - woke_us));
}

static void port_quiet(bool on)
{
    held_off = on;
}

static void port_pend(void)
{
    background_asked = true;
}

static uint32_t port_lost_bytes(void)
{
    return bytes_lost;
}

static uint32_t port_stack_unknown(void)
{
    return 0u;
}

static uint32_t port_stack_full(void)
{
    return 1u;
}

/* -- what outlasts the power: a file in memory, written through ------------------------------------ */

static bool written_through(void)
{
    return msync(kept, sizeof *kept, MS_SYNC) == 0;
}

static void flash_read(uint32_t area, uint32_t at, void *to, size_t count)
{
    memcpy(to, kept->cells[area] + at, count);
}

static bool flash_write(uint32_t area, uint32_t at, const void *from, size_t count)
{
    memcpy(kept->cells[area] + at, from, count);
    return written_through();
}

static bool flash_erase(uint32_t area)
{
    memset(kept->cells[area], 0xFF, sizeof kept->cells[area]);
    return written_through();
}

static void fail(const char *what, const char *which)
{
    fprintf(stderr, "%s %s: %s\n", what, which, strerror(errno));
    exit(2);
}

static void open_kept(esea_port_t *port, const char *name)
{
    static const esea_flash_t flash = { AREA_BYTES, flash_read, flash_write, flash_erase, 4u };
    const int file = open(name, O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0600);
    struct stat found;

    if (file < 0 || fstat(file, &found) != 0)
        fail("cannot keep anything in", name);
    if (!S_ISREG(found.st_mode) || found.st_uid != geteuid()) {
        fprintf(stderr, "cannot keep anything in %s: give a file of your own\n", name);
        exit(2);
    }
    /* Whoever reads it may command. */
    if (fchmod(file, 0600) != 0 || flock(file, LOCK_EX | LOCK_NB) != 0 || ftruncate(file, (off_t)sizeof *kept) != 0)
        fail("cannot keep anything in", name);
    kept = mmap(NULL, sizeof *kept, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
    if (kept == MAP_FAILED)
        fail("cannot keep anything in", name);
    port->store = &store;
    port->flash = &flash;
    port->blackbox = &kept->blackbox;
}

/* Of this start; 0 where the system has none. */
static uint32_t any_number(void)
{
    const int file = open("/dev/urandom", O_RDONLY | O_CLOEXEC);
    uint32_t number = 0u;

    if (file >= 0 && read(file, &number, sizeof number) != (ssize_t)sizeof number)
        number = 0u;
    if (file >= 0)
        (void)close(file);
    return number;
}

/* -- the clock ------------------------------------------------------------------------------------- */

static void on_signal(int number)
{
    if (number == SIGUSR1)
        asked = 1;
    else
        ends = 1;
}

static void take_signals(void)
{
    struct sigaction action;

    memset(&action, 0, sizeof action);
    action.sa_handler = on_signal; /* without SA_RESTART: a wait ends */
    (void)sigaction(SIGUSR1, &action, NULL);
    (void)sigaction(SIGTERM, &action, NULL);
    (void)sigaction(SIGINT, &action, NULL);
    action.sa_handler = SIG_IGN;
    (void)sigaction(SIGPIPE, &action, NULL);
}

/* As far as this program is permitted. */
static void be_prompt(int priority)
{
    const struct sched_param wanted = { .sched_priority = priority };
    volatile uint8_t stack[STACK_TOUCHED];
    size_t i;

    for (i = 0u; i < sizeof stack; i += 1024u)
        stack[i] = 0u; /* its pages are there before they are asked for */
#ifndef __SANITIZE_ADDRESS__ /* whose shadow is larger than any memory */
    if (mlockall(MCL_CURRENT | MCL_FUTURE) == 0)
        locked = "locked";
#endif
    if (priority > 0 && sched_setscheduler(0, SCHED_FIFO, &wanted) == 0)
        scheduling = "SCHED_FIFO";
}

static void start_clock(void)
{
    const struct timespec period = { 0, (long)ESEA_LINK_TICK_US * 1000 };
    struct itimerspec every = { period, { 0, 0 } };
    uint64_t first_us;

    timer = timerfd_create(CLOCK_MONOTONIC, TFD_NONBLOCK | TFD_CLOEXEC);
    due_us = now_us();
    first_us = due_us + ESEA_LINK_TICK_US;
    every.it_value.tv_sec = (time_t)(first_us / 1000000u);
    every.it_value.tv_nsec = (long)(first_us % 1000000u) * 1000;
    if (timer < 0 || timerfd_settime(timer, TFD_TIMER_ABSTIME, &every, NULL) != 0)
        fail("no clock", "");
}

int main(int argc, char **argv)
{
    static esea_port_t port = {
        .name = ESEA_BOARD_NAME,
        .receive_buffer_bytes = 65536u, /* of pipe or socket */
        .stack_bytes = 1u,              /* the system's; not measured */
        .read = port_read,
        .write = port_write,
        .room = port_room,
        .wait = port_wait,
        .ticks = port_ticks,
        .base_ticks = ESEA_LINK_TICK_US,
        .quiet = port_quiet,
        .pend = port_pend,
        .lost_bytes = port_lost_bytes,
        .stack_peak_bytes = port_stack_unknown,
    };
    const char *address = "stdio", *drive = NULL;
    bool rotor_side = false;
    int i, priority = 80;

    for (i = 1; i < argc; ++i)
        if (strcmp(argv[i], "--keep") == 0 && i + 1 < argc)
            open_kept(&port, argv[++i]);
        else if (strcmp(argv[i], "--drive") == 0 && i + 1 < argc)
            drive = argv[++i];
        else if (strcmp(argv[i], "--rotor-side") == 0)
            rotor_side = true;
        else if (strcmp(argv[i], "--priority") == 0 && i + 1 < argc)
            priority = atoi(argv[++i]);
        else if (strcmp(argv[i], "--stack-exhausted") == 0) /* for tests */
            port.stack_peak_bytes = port_stack_full;
        else
            address = argv[i];
    if (!line_open(&line, address)) {
        fprintf(stderr, "%s: give tcp:PORT, tcp:ADDRESS:PORT, serial:FILE, serial:FILE:BAUD or pty (%s)\n", address,
                strerror(errno));
        return 2;
    }
    if (line_live(&line))
        take_signals(); /* before the drive is asked, so that every end is an orderly one */
    esea_board_drivers(&port);
    if (drive != NULL && !drive_open(&port, drive, rotor_side))
        return 2;
    port.unique = any_number();
    if (line_live(&line))
        be_prompt(priority);
    esea_app_init(&app, &port);
    if (line_live(&line))
        start_clock();
    while (!ends && !line_over(&line))
        esea_app_poll(&app);
    esea_app_motor_off(&app);
    if (line_live(&line))
        print_lateness();
    return 0;
}
