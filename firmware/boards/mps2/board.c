/* ARM MPS2, with the AN385 image (Cortex-M3 without an FPU) or the AN500 image (Cortex-M7).
 *
 * Verified in QEMU's machines mps2-an385 and mps2-an500.  Registers as in ARM's application notes
 * AN385 and AN500 and the Cortex-M System Design Kit's manual (DDI 0479); not tried on a real board.
 *
 * License: MIT. */
#include "cortex_m.h"

/* Timer 0: counts down at the processor's clock. */
#define TIMER0_CTRL ESEA_REG(0x40000000u)
#define TIMER0_CTRL_ENABLE (1u << 0)
#define TIMER0_VALUE ESEA_REG(0x40000004u)
#define TIMER0_RELOAD ESEA_REG(0x40000008u)

/* UART 0: one byte each way; receive interrupt 0. */
#define UART0_DATA ESEA_REG(0x40004000u)
#define UART0_STATE ESEA_REG(0x40004004u)
#define UART_STATE_TX_FULL (1u << 0)
#define UART_STATE_RX_FULL (1u << 1)
#define UART0_CTRL ESEA_REG(0x40004008u)
#define UART_CTRL_TX (1u << 0)
#define UART_CTRL_RX (1u << 1)
#define UART_CTRL_RX_INTERRUPT (1u << 3)
#define UART0_INTCLEAR ESEA_REG(0x4000400Cu)
#define UART_INT_RX (1u << 1)
#define UART0_BAUDDIV ESEA_REG(0x40004010u)
#define BAUD 115200u
#define UART0_RX_IRQ 0u

void esea_uart0_receive_handler(void);

const char esea_board_name[] = ESEA_BOARD_NAME;
uint32_t esea_board_clock_MHz = ESEA_CLOCK_HZ / 1000000u;

void esea_uart0_receive_handler(void)
{
    UART0_INTCLEAR = UART_INT_RX; /* before reading: the next byte may follow at once */
    while (UART0_STATE & UART_STATE_RX_FULL)
        esea_cortex_m_received((uint8_t)UART0_DATA);
}

void esea_board_send(uint8_t byte)
{
    while (UART0_STATE & UART_STATE_TX_FULL) {
    }
    UART0_DATA = byte;
}

uint32_t esea_board_ticks(void)
{
    return UINT32_MAX - TIMER0_VALUE;
}

void esea_board_start(void)
{
    TIMER0_RELOAD = UINT32_MAX;
    TIMER0_VALUE = UINT32_MAX;
    TIMER0_CTRL = TIMER0_CTRL_ENABLE;

    UART0_BAUDDIV = (ESEA_CLOCK_HZ + BAUD / 2u) / BAUD;
    UART0_CTRL = UART_CTRL_TX | UART_CTRL_RX | UART_CTRL_RX_INTERRUPT;
    ESEA_NVIC_PRIORITY(UART0_RX_IRQ) |= ESEA_PRIORITY_OF(UART0_RX_IRQ, ESEA_PRIORITY_RECEIVE);
    ESEA_NVIC_ISER(0) = 1u << UART0_RX_IRQ;
}

ESEA_VECTORS(UART0_RX_IRQ) = {
    ESEA_CORE_VECTORS,
    [16u + UART0_RX_IRQ] = { .handler = esea_uart0_receive_handler },
};
