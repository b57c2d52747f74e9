/* Netduino Plus 2: STM32F405, Cortex-M4F.  Start-up, vector table and port.
 *
 * Verified in QEMU's machine of that name.  Clock, pins and baud rate are set as the reference
 * manual says, but have not been tried on a real board; the emulator ignores them.
 *
 * License: MIT. */
#include <string.h>

#include "app.h"
#include "port.h"
#include "stm32f405.h"

#define RECEIVE_BUFFER_BYTES 1024u /* a power of two */
#define STACK_PAINT 0xA5A5A5A5u

/* From the linker script. */
extern uint32_t esea_data_load[], esea_data_start[], esea_data_end[], esea_bss_start[], esea_bss_end[];
extern uint32_t esea_stack_limit[], esea_stack_top[];

void esea_reset_handler(void);
void esea_fault_handler(void);
void esea_fault_report(void);
void esea_usart1_handler(void);

/* The interrupt writes `head`, the application `tail`; both run free and are taken modulo the size. */
static struct {
    volatile uint32_t head, tail, lost;
    volatile uint8_t bytes[RECEIVE_BUFFER_BYTES];
} receiver;

static esea_app_t app;

void esea_usart1_handler(void)
{
    while (ESEA_USART1_SR & ESEA_USART_SR_RXNE) {
        const uint8_t byte = (uint8_t)ESEA_USART1_DR;

        if (receiver.head - receiver.tail < RECEIVE_BUFFER_BYTES) {
            receiver.bytes[receiver.head % RECEIVE_BUFFER_BYTES] = byte;
            receiver.head = receiver.head + 1u;
        } else if (receiver.lost != UINT32_MAX) {
            receiver.lost = receiver.lost + 1u;
        }
    }
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

    for (i = 0u; i < count; ++i) {
        while (!(ESEA_USART1_SR & ESEA_USART_SR_TXE)) {
        }
        ESEA_USART1_DR = bytes[i];
    }
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
    /* Interrupts are off between the look and the sleep, so that no byte comes in unseen; one that
     * is pending ends the sleep all the same. */
    port_quiet(true);
    if (receiver.tail == receiver.head)
        __asm__ volatile("dsb\n\twfi" ::: "memory");
    port_quiet(false);
}

static uint32_t port_ticks(void)
{
    return ESEA_TIM2_CNT;
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

static void start_peripherals(void)
{
    ESEA_RCC_AHB1ENR |= ESEA_RCC_AHB1ENR_GPIOB;
    ESEA_RCC_APB1ENR |= ESEA_RCC_APB1ENR_TIM2;
    ESEA_RCC_APB2ENR |= ESEA_RCC_APB2ENR_USART1;
    __asm__ volatile("dsb" ::: "memory"); /* a clock needs two cycles to start */

    /* PB6 and PB7: alternate function 7. */
    ESEA_GPIOB_MODER = (ESEA_GPIOB_MODER & ~(0xFu << 12)) | (0xAu << 12);
    ESEA_GPIOB_AFRL = (ESEA_GPIOB_AFRL & ~(0xFFu << 24)) | (0x77u << 24);

    ESEA_TIM2_PSC = 0u;
    ESEA_TIM2_ARR = UINT32_MAX;
    ESEA_TIM2_EGR = ESEA_TIM2_EGR_UG;
    ESEA_TIM2_CR1 = ESEA_TIM2_CR1_CEN;

    ESEA_USART1_BRR = ESEA_USART_BRR_115200_AT_16MHZ;
    ESEA_USART1_CR1 = ESEA_USART_CR1_UE | ESEA_USART_CR1_TE | ESEA_USART_CR1_RE | ESEA_USART_CR1_RXNEIE;
    ESEA_NVIC_ISER1 = 1u << (ESEA_USART1_IRQ - 32u);
}

static void run(void)
{
    static esea_port_t port = {
        .name = "netduinoplus2",
        .receive_buffer_bytes = RECEIVE_BUFFER_BYTES,
        .read = port_read,
        .write = port_write,
        .wait = port_wait,
        .ticks = port_ticks,
        .quiet = port_quiet,
        .lost_bytes = port_lost_bytes,
        .stack_peak_bytes = port_stack_peak_bytes,
    };

    port.stack_bytes = (uint32_t)(esea_stack_top - esea_stack_limit) * (uint32_t)sizeof(uint32_t);
    start_peripherals();
    esea_app_init(&app, &port);
    for (;;)
        esea_app_poll(&app);
}

void esea_reset_handler(void)
{
    volatile uint32_t *word; /* volatile: a call of memset would paint over its own frame */
    uint32_t *here;

    ESEA_CPACR |= ESEA_CPACR_FPU_FULL;
    __asm__ volatile("dsb\n\tisb" ::: "memory");

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

typedef void (*esea_vector_t)(void);

/* The first entry is the initial stack pointer, hence the union. */
typedef union {
    uint32_t *stack;
    esea_vector_t handler;
} esea_vector_entry_t;

__attribute__((section(".vectors"), used)) static const esea_vector_entry_t vectors[16u + ESEA_USART1_IRQ + 1u] = {
    [0] = { .stack = esea_stack_top },
    [1] = { .handler = esea_reset_handler },
    [2] = { .handler = esea_fault_handler },  /* NMI */
    [3] = { .handler = esea_fault_handler },  /* HardFault; the ones below escalate to it */
    [4] = { .handler = esea_fault_handler },  /* MemManage */
    [5] = { .handler = esea_fault_handler },  /* BusFault */
    [6] = { .handler = esea_fault_handler },  /* UsageFault */
    [11] = { .handler = esea_fault_handler }, /* SVCall, not used */
    [14] = { .handler = esea_fault_handler }, /* PendSV, not used */
    [15] = { .handler = esea_fault_handler }, /* SysTick, not used */
    [16u + ESEA_USART1_IRQ] = { .handler = esea_usart1_handler },
};
