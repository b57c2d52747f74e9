/* Clock of the STM32F405: 168 MHz by its PLL, of the crystal, or of the internal oscillator where that does not
 * start.  In the order of the reference manual (RM0090, 3.5.1 and 7.3): regulator and source, wait states and
 * dividers, then the PLL, which is set while it is off, then the switch.  Every wait has an end; where one is
 * reached the board stays at the internal 16 MHz, as after a reset.  Held against a model of the registers, not
 * tried on a real board.
 *
 * License: MIT. */
#include "stm32f405.h"

#if ESEA_CLOCK_HZ != 168000000u || ESEA_RESET_HZ != 16000000u
#error "this file sets 168 MHz, and 16 MHz where the PLL does not lock"
#endif

#define LOOKS 10000u          /* 3 ms and more at 16 MHz; the PLL locks in 0.3 */
#define LOOKS_CRYSTAL 100000u /* 30 ms; a crystal takes 2 */

uint32_t esea_board_clock_MHz = ESEA_RESET_HZ / 1000000u;

static bool switched_to(uint32_t source)
{
    ESEA_CHANGE(ESEA_RCC_CFGR, ESEA_RCC_CFGR_SW, source);
    return esea_board_until(ESEA_RCC_CFGR_AT, ESEA_RCC_CFGR_SWS, source << 2, LOOKS);
}

static bool crystal_starts(void)
{
    ESEA_RCC_CR |= ESEA_RCC_CR_HSEON;
    if (esea_board_until(ESEA_RCC_CR_AT, ESEA_RCC_CR_HSERDY, ESEA_RCC_CR_HSERDY, LOOKS_CRYSTAL))
        return true;
    ESEA_RCC_CR &= ~ESEA_RCC_CR_HSEON;
    return false;
}

/* 1 MHz times 336 by 2, and by 7 for the 48 MHz that nobody uses here. */
static bool locks(bool crystal)
{
    ESEA_RCC_CR &= ~ESEA_RCC_CR_PLLON;
    if (!esea_board_until(ESEA_RCC_CR_AT, ESEA_RCC_CR_PLLRDY, 0u, LOOKS))
        return false;
    ESEA_CHANGE(ESEA_RCC_PLLCFGR, ESEA_RCC_PLLCFGR_ALL,
            (crystal ? ESEA_RCC_PLLCFGR_HSE | ESEA_CRYSTAL_MHZ : ESEA_RESET_HZ / 1000000u) | 336u << 6 | 7u << 24);
    ESEA_RCC_CR |= ESEA_RCC_CR_PLLON;
    return esea_board_until(ESEA_RCC_CR_AT, ESEA_RCC_CR_PLLRDY, ESEA_RCC_CR_PLLRDY, LOOKS);
}

/* All as after a reset. */
static void stay(void)
{
    (void)switched_to(ESEA_RCC_CFGR_HSI);
    ESEA_RCC_CR &= ~(ESEA_RCC_CR_PLLON | ESEA_RCC_CR_HSEON);
    ESEA_CHANGE(ESEA_RCC_CFGR, ESEA_RCC_CFGR_DIVIDERS, 0u);
    ESEA_FLASH_ACR = 0u;
}

void esea_board_start_clock(void)
{
    bool crystal, locked = false;

    /* Whoever started the image, a loader or a debugger, may have left another clock. */
    ESEA_RCC_CR |= ESEA_RCC_CR_HSION;
    if (!esea_board_until(ESEA_RCC_CR_AT, ESEA_RCC_CR_HSIRDY, ESEA_RCC_CR_HSIRDY, LOOKS) ||
            !switched_to(ESEA_RCC_CFGR_HSI))
        return;
    ESEA_RCC_APB1ENR |= ESEA_RCC_APB1ENR_PWR;
    __asm__ volatile("dsb" ::: "memory");
    ESEA_RCC_CR &= ~(ESEA_RCC_CR_PLLON | ESEA_RCC_CR_CSSON);
    (void)esea_board_until(ESEA_RCC_CR_AT, ESEA_RCC_CR_PLLRDY, 0u, LOOKS);
    ESEA_PWR_CR |= ESEA_PWR_CR_VOS; /* scale 1, above 144 MHz */
    crystal = crystal_starts();

    ESEA_FLASH_ACR = ESEA_FLASH_ACR_5_WAITS | ESEA_FLASH_ACR_ICEN | ESEA_FLASH_ACR_DCEN;
    ESEA_CHANGE(ESEA_RCC_CFGR, ESEA_RCC_CFGR_DIVIDERS, ESEA_RCC_CFGR_APB1_BY_4 | ESEA_RCC_CFGR_APB2_BY_2);
    if (esea_board_until(ESEA_FLASH_ACR_AT, ESEA_FLASH_ACR_WAITS, ESEA_FLASH_ACR_5_WAITS, LOOKS)) {
        crystal = crystal && locks(true);
        locked = crystal || locks(false);
    }
    if (!locked || !switched_to(ESEA_RCC_CFGR_PLL)) {
        stay();
        return;
    }
    if (crystal)
        ESEA_RCC_CR |= ESEA_RCC_CR_CSSON; /* where it stops: the internal oscillator, and the fault handler */
    else
        ESEA_RCC_CR &= ~ESEA_RCC_CR_HSEON;
    if (ESEA_DBGMCU_IDCODE >> 16 > 0x1000u) /* the first parts have no prefetch that could be used */
        ESEA_FLASH_ACR |= ESEA_FLASH_ACR_PRFTEN;
    esea_board_clock_MHz = ESEA_CLOCK_HZ / 1000000u;
}
