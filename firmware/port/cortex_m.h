/* What all boards with a Cortex-M share: start-up, fault handlers, receive buffer, stack measurement,
 * main loop.  A board supplies the functions below and the vector table, in which its receive
 * interrupt calls esea_cortex_m_received.
 *
 * License: MIT. */
#ifndef ESEA_CORTEX_M_H
#define ESEA_CORTEX_M_H

#include <stdint.h>

#define ESEA_REG(address) (*(volatile uint32_t *)(address))
#define ESEA_NVIC_ISER(word) ESEA_REG(0xE000E100u + 4u * (word))

/* From the board: its name (at most 15 characters), clocks and peripherals, a free-running counter of 32
 * bits, and a byte to the serial line as soon as that takes it. */
extern const char esea_board_name[];
void esea_board_start(void);
uint32_t esea_board_ticks(void);
void esea_board_send(uint8_t byte);

/* To the board, called with each byte that came in. */
void esea_cortex_m_received(uint8_t byte);

/* From the linker script. */
extern uint32_t esea_stack_top[];

void esea_reset_handler(void);
void esea_fault_handler(void);

typedef void (*esea_vector_t)(void);

/* The first entry is the initial stack pointer, hence the union. */
typedef union {
    uint32_t *stack;
    esea_vector_t handler;
} esea_vector_entry_t;

/* A vector table up to interrupt `last`: ESEA_VECTORS(37) = { ESEA_CORE_VECTORS, [16u + 37u] = ... }; */
#define ESEA_VECTORS(last)                                                                         \
    __attribute__((section(".vectors"), used)) static const esea_vector_entry_t vectors[16u + (last) + 1u]

#define ESEA_CORE_VECTORS                                                                          \
    [0] = { .stack = esea_stack_top }, [1] = { .handler = esea_reset_handler },                    \
    [2] = { .handler = esea_fault_handler },  /* NMI */                                            \
    [3] = { .handler = esea_fault_handler },  /* HardFault; the ones below escalate to it */       \
    [4] = { .handler = esea_fault_handler },  /* MemManage */                                      \
    [5] = { .handler = esea_fault_handler },  /* BusFault */                                       \
    [6] = { .handler = esea_fault_handler },  /* UsageFault */                                     \
    [11] = { .handler = esea_fault_handler }, /* SVCall, not used */                               \
    [14] = { .handler = esea_fault_handler }, /* PendSV, not used */                               \
    [15] = { .handler = esea_fault_handler }  /* SysTick, not used */

#endif
