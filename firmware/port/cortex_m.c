/* Shared code of all boards with a Cortex-M; see cortex_m.h.
 *
 * License: MIT. */
#include "cortex_m.h"

#include <string.h>

#include "app.h"
#include "port.h"

#define RECEIVE_BUFFER_BYTES 1024u /* a power of two */
#define STACK_PAINT 0xA5A5A5A5u

#define ESEA_ICSR ESEA_REG(0xE000ED04u)
#define ESEA_ICSR_PENDSVSET (1u << 28)
#define ESEA_SHPR3 ESEA_REG(0xE000ED20u) /* priorities of PendSV and SysTick */
#define ESEA_SYST_CSR ESEA_REG(0xE000E010u)
#define ESEA_SYST_CSR_ENABLE (1u << 0)
#define ESEA_SYST_CSR_TICKINT (1u << 1)
#define ESEA_SYST_CSR_CLKSOURCE (1u << 2) /* the processor's clock */
#define ESEA_SYST_CSR_COUNTFLAG (1u << 16)
#define ESEA_SYST_RVR ESEA_REG(0xE000E014u)
#define ESEA_SYST_CVR ESEA_REG(0xE000E018u)
#define ESEA_CPACR ESEA_REG(0xE000ED88u)
#define ESEA_CPACR_FPU_FULL (0xFu << 20)

/* From the linker script. */
extern uint32_t esea_data_load[], esea_data_start[], esea_data_end[], esea_bss_start[], esea_bss_end[];
extern uint32_t esea_stack_limit[];

void esea_fault_report(void);

/* The interrupt writes `head`, the application `tail`; both run free and are taken modulo the size. */
static struct {
    volatile uint32_t head, tail, lost;
    volatile uint8_t bytes[RECEIVE_BUFFER_BYTES];
} receiver;

static esea_port_t port;
static esea_app_t app;
static esea_store_t store;

__attribute__((section(".noinit"))) static esea_blackbox_t blackbox;

void esea_cortex_m_received(uint8_t byte)
{
    if (receiver.head - receiver.tail < RECEIVE_BUFFER_BYTES) {
        receiver.bytes[receiver.head % RECEIVE_BUFFER_BYTES] = byte;
        receiver.head = receiver.head + 1u;
    } else if (receiver.lost != UINT32_MAX) {
        receiver.lost = receiver.lost + 1u;
    }
}

void esea_tick_handler(void)
{
    esea_app_tick(&app);
}

void esea_slower_handler(void)
{
    esea_app_background(&app);
}

static size_t port_read(uint8_t *bytes, size_t capacity)
{
    size_t n = 0u;

    while (n < capacity && receiver.tail != receiver.head) {
        bytes[n++] = receiver.bytes[receiver.tail % RECEIVE_BUFFER_BYTES];
        receiver.tail = receiver.tail + 1u;
    }
    return n;
}

static void port_write(const uint8_t *bytes, size_t count)
{
    size_t i;

    for (i = 0u; i < count; ++i)
        esea_board_send(bytes[i]);
}

static void port_quiet(bool on)
{
    if (on)
        __asm__ volatile("cpsid i" ::: "memory");
    else
        __asm__ volatile("cpsie i" ::: "memory");
}

static void port_wait(void)
{
    /* On the own clock it does not sleep: waking would shift the tick, by less or more. */
    if (app.clock.runs)
        return;
    /* Interrupts are off between the look and the sleep, so that no byte comes in unseen; one that
     * is pending ends the sleep all the same. */
    port_quiet(true);
    if (receiver.tail == receiver.head)
        __asm__ volatile("dsb\n\twfi" ::: "memory");
    port_quiet(false);
}

static void port_pend(void)
{
    ESEA_ICSR = ESEA_ICSR_PENDSVSET;
}

static uint32_t port_lost_bytes(void)
{
    return receiver.lost;
}

static uint32_t port_stack_peak_bytes(void)
{
    const uint32_t *word = esea_stack_limit;

    while (word < esea_stack_top && *word == STACK_PAINT)
        ++word;
    return (uint32_t)(esea_stack_top - word) * (uint32_t)sizeof *word;
}

static uint32_t count_at_tick(void)
{
    while (!(ESEA_SYST_CSR & ESEA_SYST_CSR_COUNTFLAG)) {
    }
    return esea_board_ticks();
}

/* Starts the base tick, 24 bits of the processor's clock; returns how many counts of the board's
 * counter it takes, measured over one. */
static uint32_t start_ticks(void)
{
    uint32_t first, second;

    ESEA_SYST_RVR = ESEA_LINK_TICK_US * esea_board_clock_MHz - 1u;
    ESEA_SYST_CVR = 0u;
    ESEA_SYST_CSR = ESEA_SYST_CSR_ENABLE | ESEA_SYST_CSR_CLKSOURCE;
    first = count_at_tick();
    second = count_at_tick();
    ESEA_SYST_CSR = ESEA_SYST_CSR_ENABLE | ESEA_SYST_CSR_CLKSOURCE | ESEA_SYST_CSR_TICKINT;
    return second - first;
}

static void run(void)
{
    static const esea_port_t board = {
        .name = esea_board_name,
        .receive_buffer_bytes = RECEIVE_BUFFER_BYTES,
        .read = port_read,
        .write = port_write,
        .wait = port_wait,
        .ticks = esea_board_ticks,
        .quiet = port_quiet,
        .pend = port_pend,
        .lost_bytes = port_lost_bytes,
        .stack_peak_bytes = port_stack_peak_bytes,
        .blackbox = &blackbox,
    };

    port = board;
    port.stack_bytes = (uint32_t)(esea_stack_top - esea_stack_limit) * (uint32_t)sizeof(uint32_t);
    ESEA_SHPR3 = ESEA_PRIORITY_TICK << 24 | ESEA_PRIORITY_SLOWER << 16;
    esea_board_start();
    port.store = &store;
    esea_board_drivers(&port);
    if (port.flash == NULL)
        port.store = NULL;
    esea_app_init(&app, &port);
    port.base_ticks = start_ticks();
    for (;;)
        esea_app_poll(&app);
}

void esea_reset_handler(void)
{
    volatile uint32_t *word; /* volatile: a call of memset would paint over its own frame */
    uint32_t *here;

#ifdef __ARM_FP
    ESEA_CPACR |= ESEA_CPACR_FPU_FULL;
    __asm__ volatile("dsb\n\tisb" ::: "memory");
#endif

    memcpy(esea_data_start, esea_data_load, (size_t)(esea_data_end - esea_data_start) * sizeof(uint32_t));
    memset(esea_bss_start, 0, (size_t)(esea_bss_end - esea_bss_start) * sizeof(uint32_t));

    /* Paint the stack below this frame; what is no longer painted has been used. */
    __asm__ volatile("mov %0, sp" : "=r"(here));
    for (word = esea_stack_limit; word < here; ++word)
        *word = STACK_PAINT;

    run();
}

/* Any fault exception: the state cannot be trusted any more, so tell of it and halt. */
void esea_fault_report(void)
{
    if (app.port != NULL)
        esea_app_fail(&app, ESEA_FAULT_PROCESSOR);
    for (;;)
        __asm__ volatile("wfi");
}

__attribute__((naked)) void esea_fault_handler(void)
{
    /* The stack may be what went wrong: start on a fresh one. */
    __asm__ volatile("cpsid i\n\t"
                     "ldr r0, =esea_stack_top\n\t"
                     "mov sp, r0\n\t"
                     "b esea_fault_report\n\t"
                     ".ltorg");
}
