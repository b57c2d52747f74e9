/* Shared code of all boards with a Cortex-M: start-up, fault handlers, receive buffer, stack measurement,
 * base tick, main loop.  A board supplies the functions below and the vector table, in which its
 * receive interrupt calls esea_cortex_m_received.
 *
 * Priorities, the highest first: faults; receiving, some dozen instructions a byte, which no step may
 * delay, because the hardware buffers one byte only; the base tick (SysTick); the slower tasks (PendSV); the
 * main loop.
 *
 * License: MIT. */
#ifndef ESEA_CORTEX_M_H
#define ESEA_CORTEX_M_H

#include <stdint.h>

#include "port.h"

#define ESEA_REG(address) (*(volatile uint32_t *)(address))
#define ESEA_NVIC_ISER(word) ESEA_REG(0xE000E100u + 4u * (word))
/* A priority is a byte; written as a word, which has those of four interrupts. */
#define ESEA_NVIC_PRIORITY(irq) ESEA_REG(0xE000E400u + ((irq) & ~3u))
#define ESEA_PRIORITY_OF(irq, priority) ((uint32_t)(priority) << (8u * ((irq) & 3u)))
#define ESEA_PRIORITY_RECEIVE 0x20u
#define ESEA_PRIORITY_TICK 0x40u
#define ESEA_PRIORITY_SLOWER 0xE0u

/* From the board: its name (at most 15 characters), clocks and peripherals, a free-running counter of 32
 * bits, and a byte to the serial line as soon as that takes it. */
extern const char esea_board_name[];
void esea_board_start(void);
uint32_t esea_board_ticks(void);
void esea_board_send(uint8_t byte);
/* Of the processor, and so of SysTick, since esea_board_start: ESEA_CLOCK_HZ of the build, or ESEA_RESET_HZ where
 * that does not come.  A drive that needs more (ESEA_NEEDS_HZ) must then not come to arm. */
extern uint32_t esea_board_clock_MHz;

/* To the board, called with each byte that came in. */
void esea_cortex_m_received(uint8_t byte);

/* From the linker script. */
extern uint32_t esea_stack_top[];

void esea_reset_handler(void);
void esea_fault_handler(void);
void esea_slower_handler(void);
void esea_tick_handler(void);

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
    [14] = { .handler = esea_slower_handler }, /* PendSV */                                       \
    [15] = { .handler = esea_tick_handler }    /* SysTick */

#endif
