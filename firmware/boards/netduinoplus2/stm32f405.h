/* The few registers of the STM32F405 that this board uses (ST reference manual RM0090).
 *
 * License: MIT. */
#ifndef ESEA_STM32F405_H
#define ESEA_STM32F405_H

#include "cortex_m.h"

/* Clocks.  After reset the core runs from the internal oscillator, 16 MHz. */
#define ESEA_RCC_AHB1ENR ESEA_REG(0x40023830u)
#define ESEA_RCC_AHB1ENR_GPIOB (1u << 1)
#define ESEA_RCC_APB1ENR ESEA_REG(0x40023840u)
#define ESEA_RCC_APB1ENR_TIM2 (1u << 0)
#define ESEA_RCC_APB2ENR ESEA_REG(0x40023844u)
#define ESEA_RCC_APB2ENR_USART1 (1u << 4)

/* Pins PB6 (TX) and PB7 (RX). */
#define ESEA_GPIOB_MODER ESEA_REG(0x40020400u)
#define ESEA_GPIOB_AFRL ESEA_REG(0x40020420u)

/* Timer 2: 32 bits. */
#define ESEA_TIM2_CR1 ESEA_REG(0x40000000u)
#define ESEA_TIM2_CR1_CEN (1u << 0)
#define ESEA_TIM2_EGR ESEA_REG(0x40000014u)
#define ESEA_TIM2_EGR_UG (1u << 0)
#define ESEA_TIM2_CNT ESEA_REG(0x40000024u)
#define ESEA_TIM2_PSC ESEA_REG(0x40000028u)
#define ESEA_TIM2_ARR ESEA_REG(0x4000002Cu)

/* USART 1, interrupt 37. */
#define ESEA_USART1_SR ESEA_REG(0x40011000u)
#define ESEA_USART_SR_RXNE (1u << 5)
#define ESEA_USART_SR_TXE (1u << 7)
#define ESEA_USART1_DR ESEA_REG(0x40011004u)
#define ESEA_USART1_BRR ESEA_REG(0x40011008u)
#define ESEA_USART_BRR_115200_AT_16MHZ 0x8Bu /* 16 MHz / (16 * 115200) = 8 + 11/16 */
#define ESEA_USART1_CR1 ESEA_REG(0x4001100Cu)
#define ESEA_USART_CR1_RE (1u << 2)
#define ESEA_USART_CR1_TE (1u << 3)
#define ESEA_USART_CR1_RXNEIE (1u << 5)
#define ESEA_USART_CR1_UE (1u << 13)
#define ESEA_USART1_IRQ 37u

#endif
