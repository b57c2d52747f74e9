/* The few registers of the STM32F405 that this board uses (ST reference manual RM0090).
 *
 * License: MIT. */
#ifndef ESEA_STM32F405_H
#define ESEA_STM32F405_H

#include "cortex_m.h"

/* Bits of a register that are others now. */
#define ESEA_CHANGE(reg, mask, bits) ((reg) = ((reg) & ~(uint32_t)(mask)) | (uint32_t)(bits))

/* Clocks.  After reset the core runs from the internal oscillator, 16 MHz (HSI); the board's crystal has 25 (HSE). */
#define ESEA_CRYSTAL_MHZ 25u
#define ESEA_RCC_CR_AT 0x40023800u
#define ESEA_RCC_CR ESEA_REG(ESEA_RCC_CR_AT)
#define ESEA_RCC_CR_HSION (1u << 0)
#define ESEA_RCC_CR_HSIRDY (1u << 1)
#define ESEA_RCC_CR_HSEON (1u << 16)
#define ESEA_RCC_CR_HSERDY (1u << 17)
#define ESEA_RCC_CR_CSSON (1u << 19)
#define ESEA_RCC_CR_PLLON (1u << 24)
#define ESEA_RCC_CR_PLLRDY (1u << 25)
#define ESEA_RCC_PLLCFGR ESEA_REG(0x40023804u)
#define ESEA_RCC_PLLCFGR_ALL 0x0F437FFFu /* all but what is reserved */
#define ESEA_RCC_PLLCFGR_HSE (1u << 22)
#define ESEA_RCC_CFGR_AT 0x40023808u
#define ESEA_RCC_CFGR ESEA_REG(ESEA_RCC_CFGR_AT)
#define ESEA_RCC_CFGR_SW 3u
#define ESEA_RCC_CFGR_SWS (3u << 2)
#define ESEA_RCC_CFGR_HSI 0u
#define ESEA_RCC_CFGR_PLL 2u
#define ESEA_RCC_CFGR_DIVIDERS 0xFCF0u /* of the core, of APB 1 and 2 */
#define ESEA_RCC_CFGR_APB1_BY_4 (5u << 10)
#define ESEA_RCC_CFGR_APB2_BY_2 (4u << 13)
#define ESEA_RCC_AHB1ENR ESEA_REG(0x40023830u)
#define ESEA_RCC_AHB1ENR_GPIOA (1u << 0)
#define ESEA_RCC_AHB1ENR_GPIOB (1u << 1)
#define ESEA_RCC_AHB1ENR_GPIOC (1u << 2)
#define ESEA_RCC_APB1ENR ESEA_REG(0x40023840u)
#define ESEA_RCC_APB1ENR_TIM2 (1u << 0)
#define ESEA_RCC_APB1ENR_TIM3 (1u << 1)
#define ESEA_RCC_APB1ENR_SPI2 (1u << 14)
#define ESEA_RCC_APB1ENR_SPI3 (1u << 15)
#define ESEA_RCC_APB1ENR_PWR (1u << 28)
#define ESEA_RCC_APB2ENR ESEA_REG(0x40023844u)
#define ESEA_RCC_APB2ENR_USART1 (1u << 4)
#define ESEA_RCC_APB2ENR_ADC1 (1u << 8)
#define ESEA_RCC_APB2ENR_SPI1 (1u << 12)
#define ESEA_RCC_CSR ESEA_REG(0x40023874u)
#define ESEA_RCC_CSR_RMVF (1u << 24) /* forgets why */
#define ESEA_RCC_CSR_IWDGRSTF (1u << 29)

/* Pins, port 0 is A: two bits a pin of mode, of pull; a bit of input; set and reset; four of function. */
#define ESEA_GPIO_MODER(port) ESEA_REG(0x40020000u + 0x400u * (port))
#define ESEA_GPIO_OSPEEDR(port) ESEA_REG(0x40020008u + 0x400u * (port))
#define ESEA_GPIO_PUPDR(port) ESEA_REG(0x4002000Cu + 0x400u * (port))
#define ESEA_GPIO_IDR(port) ESEA_REG(0x40020010u + 0x400u * (port))
#define ESEA_GPIO_BSRR(port) ESEA_REG(0x40020018u + 0x400u * (port))
#define ESEA_GPIO_AFR(port, pin) ESEA_REG(0x40020020u + 0x400u * (port) + 4u * ((pin) / 8u))
#define ESEA_GPIO_OUTPUT 1u
#define ESEA_GPIO_FUNCTION 2u
#define ESEA_GPIO_ANALOG 3u
#define ESEA_GPIO_PULL_DOWN 2u
#define ESEA_GPIO_25MHZ 1u

/* Pins PB6 (TX) and PB7 (RX). */
#define ESEA_GPIOB_MODER ESEA_GPIO_MODER(1u)
#define ESEA_GPIOB_AFRL ESEA_GPIO_AFR(1u, 0u)

/* SPI 1 to 3, by the address of their first register. */
#define ESEA_SPI1 0x40013000u
#define ESEA_SPI2 0x40003800u
#define ESEA_SPI3 0x40003C00u
#define ESEA_SPI_CR1(spi) ESEA_REG((spi) + 0x00u)
#define ESEA_SPI_CR1_CPHA (1u << 0)
#define ESEA_SPI_CR1_CPOL (1u << 1)
#define ESEA_SPI_CR1_MSTR (1u << 2)
#define ESEA_SPI_CR1_BY_4 (1u << 3) /* of the bus's clock */
#define ESEA_SPI_CR1_BY_8 (2u << 3)
#define ESEA_SPI_CR1_BY_16 (3u << 3)
#define ESEA_SPI_CR1_SPE (1u << 6)
#define ESEA_SPI_CR1_SSI (1u << 8)
#define ESEA_SPI_CR1_SSM (1u << 9)
#define ESEA_SPI_SR(spi) ESEA_REG((spi) + 0x08u)
#define ESEA_SPI_SR_RXNE (1u << 0)
#define ESEA_SPI_SR_BSY (1u << 7)
#define ESEA_SPI_DR(spi) ESEA_REG((spi) + 0x0Cu)

/* Timer 3: 16 bits, its first and its last channel as PWM. */
#define ESEA_TIM3_CR1 ESEA_REG(0x40000400u)
#define ESEA_TIM3_CR1_CEN (1u << 0)
#define ESEA_TIM3_CR1_ARPE (1u << 7)
#define ESEA_TIM3_EGR ESEA_REG(0x40000414u)
#define ESEA_TIM3_CCMR1 ESEA_REG(0x40000418u)
#define ESEA_TIM3_CCMR1_PWM_1 (6u << 4 | 1u << 3) /* PWM mode 1, taken over at the end of a period */
#define ESEA_TIM3_CCMR2 ESEA_REG(0x4000041Cu)
#define ESEA_TIM3_CCMR2_PWM_4 (6u << 12 | 1u << 11)
#define ESEA_TIM3_CCER ESEA_REG(0x40000420u)
#define ESEA_TIM3_CCER_1 (1u << 0)
#define ESEA_TIM3_CCER_4 (1u << 12)
#define ESEA_TIM3_PSC ESEA_REG(0x40000428u)
#define ESEA_TIM3_ARR ESEA_REG(0x4000042Cu)
#define ESEA_TIM3_CCR(channel) ESEA_REG(0x40000430u + 4u * (channel))

/* Converter 1. */
#define ESEA_ADC1_SR ESEA_REG(0x40012000u)
#define ESEA_ADC1_SR_EOC (1u << 1)
#define ESEA_ADC1_CR2 ESEA_REG(0x40012008u)
#define ESEA_ADC1_CR2_ADON (1u << 0)
#define ESEA_ADC1_CR2_SWSTART (1u << 30)
#define ESEA_ADC1_SMPR1 ESEA_REG(0x4001200Cu)
#define ESEA_ADC1_SQR3 ESEA_REG(0x40012034u)
#define ESEA_ADC1_DR ESEA_REG(0x4001204Cu)
#define ESEA_ADC_CCR ESEA_REG(0x40012304u)
#define ESEA_ADC_CCR_BY_4 (1u << 16) /* of APB 2; else by 2 */

/* Supply: below about 2.9 V PVDO is set. */
#define ESEA_PWR_CR ESEA_REG(0x40007000u)
#define ESEA_PWR_CR_PVDE (1u << 4)
#define ESEA_PWR_CR_2V9 (7u << 5)
#define ESEA_PWR_CR_VOS (1u << 14)
#define ESEA_PWR_CSR ESEA_REG(0x40007004u)
#define ESEA_PWR_CSR_PVDO (1u << 2)

/* Independent watchdog: a clock of its own, 32 kHz (17 to 47). */
#define ESEA_IWDG_KR ESEA_REG(0x40003000u)
#define ESEA_IWDG_KR_FEED 0xAAAAu
#define ESEA_IWDG_KR_OPEN 0x5555u
#define ESEA_IWDG_KR_START 0xCCCCu
#define ESEA_IWDG_PR ESEA_REG(0x40003004u)
#define ESEA_IWDG_PR_BY_16 2u
#define ESEA_IWDG_PR_BY_64 4u
#define ESEA_IWDG_RLR ESEA_REG(0x40003008u)
#define ESEA_IWDG_SR 0x4000300Cu /* not 0 while it takes new values */

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
#define ESEA_USART1_CR1 ESEA_REG(0x4001100Cu)
#define ESEA_USART_CR1_RE (1u << 2)
#define ESEA_USART_CR1_TE (1u << 3)
#define ESEA_USART_CR1_RXNEIE (1u << 5)
#define ESEA_USART_CR1_UE (1u << 13)
#define ESEA_USART1_IRQ 37u

/* Part, bits 0 to 11, and revision, 16 to 31. */
#define ESEA_DBGMCU_IDCODE ESEA_REG(0xE0042000u)

/* How flash is read. */
#define ESEA_FLASH_ACR_AT 0x40023C00u
#define ESEA_FLASH_ACR ESEA_REG(ESEA_FLASH_ACR_AT)
#define ESEA_FLASH_ACR_WAITS 7u
#define ESEA_FLASH_ACR_5_WAITS 5u
#define ESEA_FLASH_ACR_PRFTEN (1u << 8)
#define ESEA_FLASH_ACR_ICEN (1u << 9)
#define ESEA_FLASH_ACR_DCEN (1u << 10)
#define ESEA_FLASH_ACR_DCRST (1u << 12)

/* Flash: programmed by words; two sectors of 128 KB for what outlasts the power. */
#define ESEA_FLASH_KEYR ESEA_REG(0x40023C04u)
#define ESEA_FLASH_KEY1 0x45670123u
#define ESEA_FLASH_KEY2 0xCDEF89ABu
#define ESEA_FLASH_SR 0x40023C0Cu
#define ESEA_FLASH_SR_WRONG 0xF2u
#define ESEA_FLASH_SR_BSY (1u << 16)
#define ESEA_FLASH_CR ESEA_REG(0x40023C10u)
#define ESEA_FLASH_CR_PG (1u << 0)
#define ESEA_FLASH_CR_SER (1u << 1)
#define ESEA_FLASH_CR_SECTOR(n) ((n) << 3)
#define ESEA_FLASH_CR_BY_WORD (2u << 8)
#define ESEA_FLASH_CR_STRT (1u << 16)
#define ESEA_FLASH_CR_LOCK (1u << 31)
#define ESEA_FLASH_SECTOR 10u
#define ESEA_FLASH_AREA(area) (0x080C0000u + 0x20000u * (area))
#define ESEA_FLASH_AREA_BYTES 0x20000u

/* In flash.c. */
extern const esea_flash_t esea_board_flash;

/* Looks at a register so many times until the bits of a mask are as wanted. */
static inline bool esea_board_until(uint32_t address, uint32_t mask, uint32_t bits, uint32_t looks)
{
    for (; looks > 0u; --looks)
        if ((ESEA_REG(address) & mask) == bits)
            return true;
    return false;
}

/* In clock.c. */
void esea_board_start_clock(void);

/* Whether the clock has come to what the build names. */
static inline bool esea_board_fast(void)
{
    return esea_board_clock_MHz * 1000000u == ESEA_CLOCK_HZ;
}

/* Clock of bus APB 2 and of the timers; that of bus APB 1 is half of it where the clock is fast. */
static inline uint32_t esea_board_bus_Hz(void)
{
    return esea_board_fast() ? ESEA_CLOCK_HZ / 2u : ESEA_RESET_HZ;
}

/* Lets the watchdog wait for an erasure, or not any longer. */
void esea_board_patience(bool on);

#endif
