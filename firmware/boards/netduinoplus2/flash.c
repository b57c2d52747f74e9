/* The last two sectors of the STM32F405's flash, for non-volatile data.  Verified against a model of the
 * registers, not tried on a real board.  The processor stops while a sector is erased, a second or two: the
 * motor must be off, and the watchdog's period is extended.
 *
 * License: MIT. */
#include "cortex_m.h"
#include "stm32f405.h"

static void unlock(void)
{
    if ((ESEA_FLASH_CR & ESEA_FLASH_CR_LOCK) == 0u)
        return;
    ESEA_FLASH_KEYR = ESEA_FLASH_KEY1;
    ESEA_FLASH_KEYR = ESEA_FLASH_KEY2;
}

/* Looks run on out of the instruction cache meanwhile: for 3 s, a sector takes 2. */
static bool ends(void)
{
    return esea_board_until(ESEA_FLASH_SR, ESEA_FLASH_SR_BSY, 0u, esea_board_clock_MHz * 500000u) &&
           (ESEA_REG(ESEA_FLASH_SR) & ESEA_FLASH_SR_WRONG) == 0u;
}

static void begin(uint32_t bits)
{
    (void)ends();
    unlock();
    ESEA_REG(ESEA_FLASH_SR) = ESEA_FLASH_SR_WRONG; /* by writing ones they are cleared */
    ESEA_FLASH_CR = bits | ESEA_FLASH_CR_BY_WORD;
}

static void hw_flash_read(uint32_t area, uint32_t at, void *to, size_t count)
{
    const uint32_t from = ESEA_FLASH_AREA(area) + at;
    uint8_t *const bytes = to;
    size_t i;

    for (i = 0u; i < count; ++i)
        bytes[i] = (uint8_t)(ESEA_REG((from + i) & ~3u) >> (8u * ((from + i) & 3u)));
}

static bool hw_flash_write(uint32_t area, uint32_t at, const void *from, size_t count)
{
    const uint8_t *const bytes = from;
    bool good = true;
    size_t i;

    begin(ESEA_FLASH_CR_PG);
    for (i = 0u; i + 4u <= count && good; i += 4u) {
        ESEA_REG(ESEA_FLASH_AREA(area) + at + i) = (uint32_t)bytes[i] | (uint32_t)bytes[i + 1u] << 8 |
                                                   (uint32_t)bytes[i + 2u] << 16 | (uint32_t)bytes[i + 3u] << 24;
        good = ends();
    }
    ESEA_FLASH_CR = ESEA_FLASH_CR_LOCK;
    return good;
}

/* A write goes into the data cache, too, an erasure does not; it is emptied while it is off (RM0090, 3.5.2). */
static void empty_cache(void)
{
    if ((ESEA_FLASH_ACR & ESEA_FLASH_ACR_DCEN) == 0u)
        return;
    ESEA_FLASH_ACR &= ~ESEA_FLASH_ACR_DCEN;
    ESEA_FLASH_ACR |= ESEA_FLASH_ACR_DCRST;
    ESEA_FLASH_ACR &= ~ESEA_FLASH_ACR_DCRST;
    ESEA_FLASH_ACR |= ESEA_FLASH_ACR_DCEN;
}

static bool hw_flash_erase(uint32_t area)
{
    bool good;

    esea_board_patience(true);
    begin(ESEA_FLASH_CR_SER | ESEA_FLASH_CR_SECTOR(ESEA_FLASH_SECTOR + area));
    ESEA_FLASH_CR = ESEA_FLASH_CR | ESEA_FLASH_CR_STRT;
    good = ends();
    ESEA_FLASH_CR = ESEA_FLASH_CR_LOCK;
    empty_cache();
    esea_board_patience(false);
    return good;
}

const esea_flash_t esea_board_flash = { ESEA_FLASH_AREA_BYTES, hw_flash_read, hw_flash_write, hw_flash_erase, 4u };
