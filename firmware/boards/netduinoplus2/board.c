/* Netduino Plus 2: STM32F405, Cortex-M4F.
 *
 * Verified in QEMU's machine of that name.  Clock, pins and baud rate are set as the reference
 * manual says, but have not been tried on a real board; the emulator has no such clock, and stays at 16 MHz.
 *
 * License: MIT. */
#include "cortex_m.h"
#include "stm32f405.h"

#define BAUD 115200u

void esea_usart1_handler(void);

const char esea_board_name[] = "netduinoplus2";

void esea_usart1_handler(void)
{
    while (ESEA_USART1_SR & ESEA_USART_SR_RXNE)
        esea_cortex_m_received((uint8_t)ESEA_USART1_DR);
}

void esea_board_send(uint8_t byte)
{
    while (!(ESEA_USART1_SR & ESEA_USART_SR_TXE)) {
    }
    ESEA_USART1_DR = byte;
}

uint32_t esea_board_ticks(void)
{
    return ESEA_TIM2_CNT;
}

void esea_board_start(void)
{
    esea_board_start_clock();
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

    ESEA_USART1_BRR = (esea_board_bus_Hz() + BAUD / 2u) / BAUD; /* sixteen samples a bit */
    ESEA_USART1_CR1 = ESEA_USART_CR1_UE | ESEA_USART_CR1_TE | ESEA_USART_CR1_RE | ESEA_USART_CR1_RXNEIE;
    ESEA_NVIC_PRIORITY(ESEA_USART1_IRQ) |= ESEA_PRIORITY_OF(ESEA_USART1_IRQ, ESEA_PRIORITY_RECEIVE);
    ESEA_NVIC_ISER(1) = 1u << (ESEA_USART1_IRQ - 32u);
}

ESEA_VECTORS(ESEA_USART1_IRQ) = {
    ESEA_CORE_VECTORS,
    [16u + ESEA_USART1_IRQ] = { .handler = esea_usart1_handler },
};
