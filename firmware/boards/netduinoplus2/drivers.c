/* Drivers of the Netduino Plus 2: encoders, motors, stop line, watchdog, supply.
 *
 * Registers are set as the reference manual says and are held against a model of them; none of it has been
 * tried on a real board, nor have the amplifier's and the motor's numbers below.
 *
 *   axis 1       axis 2
 *   PA5 PA6 PA7               SPI 1: AS5048A on both sides of each coupling
 *   PA4 PB0      PC4 PC5      select that on the motor side, that on the load side
 *   PB13 PB14    PC10 PC11    SPI 2, SPI 3: BiSS-C of the motor, by an RS-422 transceiver
 *   PC6  PC7     PC9  PB12    set-point (PWM, 5 kHz) and enable of the ESCON 50/5; all pulled down outside
 *   PC0          PC1          its actual current, shifted to 0 to 3.3 V
 *   PC8                       stop line, closed to 3.3 V
 *
 * License: MIT. */
#include "app.h"
#include "as5048a.h"
#include "biss.h"
#include "cortex_m.h"
#include "escon.h"
#include "stm32f405.h"
#include "stop_line.h"

#define PATIENCE 4000u /* looks at a register until a bus counts as dead, 170 us at least; a byte takes 2 */
#define PIN(port, number) (16u * (port) + (number))
#define BISS_1 PIN(1u, 13u) /* no select; by its clock */
#define BISS_2 PIN(2u, 10u)
#define ENABLE_1 PIN(2u, 7u)
#define ENABLE_2 PIN(1u, 12u)
#define STOP_PIN PIN(2u, 8u)
#define PWM_HZ 5000u
#define SPI_FUNCTION 5u
#define SPI3_FUNCTION 6u
#define TIMER_FUNCTION 2u
#define WATCHDOG_TICKS 200u /* of 2 kHz: 100 ms, 68 to 188 */

#define AXES_MOST 2u
#if ESEA_LINK_AXES > 2 || ESEA_LINK_MOTOR_ENCODERS > 2
#error "this board has lines for two axes"
#endif
#define SECOND_AXIS (ESEA_LINK_AXES > 1u || ESEA_LINK_MOTOR_ENCODERS > 1u)

static const uint32_t motor_sides[AXES_MOST] = { PIN(0u, 4u), PIN(2u, 4u) };
static const uint32_t load_sides[AXES_MOST] = { PIN(1u, 0u), PIN(2u, 5u) };
static const uint32_t enables[AXES_MOST] = { ENABLE_1, ENABLE_2 };
static const uint32_t timer_channels[AXES_MOST] = { 1u, 4u };
static const esea_stop_line_config_t stop_config = { STOP_PIN, 20u };

/* As assumed for each motor but for its lines. */
#define MOTOR(axis, enable, converter) { \
    .pwm = (axis), .enable_pin = (enable), .adc = (converter), \
    .Nm_A = 0.05f, .full_A = 5.0f, .A_count = 0.005f, .zero_counts = 2048.0f, \
    .least_counts = 8u, .most_counts = 4087u, .bound_Nm = 0.05f, \
    .follow = 0.025f, /* a lag of 40 ms; the drive's is 35 */ \
    .ticks = 20u, \
}
static const esea_escon_config_t motor_configs[AXES_MOST] = { MOTOR(0u, ENABLE_1, 10u), MOTOR(1u, ENABLE_2, 11u) };

static const uint32_t axes = ESEA_LINK_AXES; /* in a variable: there may be none */
static esea_escon_t motors[AXES_MOST];
static float set_Nm[AXES_MOST];
static esea_stop_line_t stop_line;
static uint32_t pwm_ticks;
static bool watched, reset_by_watchdog;

static void hw_put_pin(uint32_t pin, bool high)
{
    ESEA_GPIO_BSRR(pin / 16u) = 1u << (pin % 16u + (high ? 0u : 16u));
}

static bool hw_get_pin(uint32_t pin)
{
    return (ESEA_GPIO_IDR(pin / 16u) >> (pin % 16u) & 1u) != 0u;
}

/* Of the AS5048A's selection: 350 ns before its first clock, half a clock behind the last, 350 ns until the next. */
static void select_time(void)
{
    volatile uint32_t left = esea_board_clock_MHz / 16u + 1u; /* six cycles a turn at least */

    while (left > 0u)
        left = left - 1u;
}

static bool hw_spi(uint32_t line, const uint8_t *out, uint8_t *in, size_t count)
{
    const uint32_t spi = line == BISS_1 ? ESEA_SPI2 : line == BISS_2 ? ESEA_SPI3 : ESEA_SPI1;
    bool alive = true;
    size_t i;

    if (spi == ESEA_SPI1) {
        hw_put_pin(line, false);
        select_time();
    }
    for (i = 0u; i < count && alive; ++i) {
        ESEA_SPI_DR(spi) = out[i];
        alive = esea_board_until(spi + 0x08u, ESEA_SPI_SR_RXNE, ESEA_SPI_SR_RXNE, PATIENCE);
        in[i] = (uint8_t)ESEA_SPI_DR(spi);
    }
    alive = esea_board_until(spi + 0x08u, ESEA_SPI_SR_BSY, 0u, PATIENCE) && alive;
    if (spi == ESEA_SPI1) {
        select_time();
        hw_put_pin(line, true);
        select_time();
    }
    return alive;
}

static void hw_pwm(uint32_t channel, uint32_t duty)
{
    ESEA_TIM3_CCR(timer_channels[channel]) = duty * pwm_ticks / 10000u;
}

static bool hw_adc(uint32_t channel, uint32_t *counts)
{
    bool ended;

    ESEA_ADC1_SQR3 = channel;
    ESEA_ADC1_SR = 0u;
    ESEA_ADC1_CR2 = ESEA_ADC1_CR2_ADON | ESEA_ADC1_CR2_SWSTART;
    ended = esea_board_until(0x40012000u, ESEA_ADC1_SR_EOC, ESEA_ADC1_SR_EOC, PATIENCE);
    *counts = ESEA_ADC1_DR & 0xFFFu;
    return ended;
}

static const esea_hardware_t hardware = { hw_spi, hw_put_pin, hw_get_pin, hw_pwm, hw_adc };

/* The build names the bits that the device counts with; one that wants an angle finds none. */
#if ESEA_LINK_MOTOR_ENCODERS > 0
#if ESEA_ENCODER_BITS > 14
#error "the device counts with more bits than these encoders have"
#endif
static esea_as5048a_t sides[AXES_MOST][2];

/* A count, and behind it what is wrong with it. */
static void read_side(esea_as5048a_t *sensor, uint32_t line, float *measured)
{
    const esea_as5048a_config_t config = { line, ESEA_ENCODER_BITS, 1u };
    const esea_angle_t angle = esea_as5048a_read(sensor, &config, &hardware);

    measured[0] = (float)angle.count;
    measured[1] = (float)angle.frame_error;
}

static void read_sides(float *measured)
{
    static const uint32_t motor[ESEA_LINK_MOTOR_ENCODERS] = ESEA_LINK_MOTOR_COUNTS;
    static const uint32_t load[ESEA_LINK_MOTOR_ENCODERS] = ESEA_LINK_LOAD_COUNTS;
    uint32_t axis;

    for (axis = 0u; axis < ESEA_LINK_MOTOR_ENCODERS; ++axis) {
        read_side(&sides[axis][0], motor_sides[axis], &measured[motor[axis]]);
        read_side(&sides[axis][1], load_sides[axis], &measured[load[axis]]);
    }
}

#if ESEA_LINK_GEAR_ENCODERS > 0
#if ESEA_GEAR_BITS > 24
#error "the device counts with more bits than the motor's encoder has"
#endif
static void read_gears(float *measured)
{
    static const uint32_t places[ESEA_LINK_GEAR_ENCODERS] = ESEA_LINK_GEAR_COUNTS;
    static const uint32_t lines[AXES_MOST] = { BISS_1, BISS_2 };
    static esea_biss_t gears[AXES_MOST];
    uint32_t axis;

    for (axis = 0u; axis < ESEA_LINK_GEAR_ENCODERS; ++axis) {
        const esea_biss_config_t config = { lines[axis], ESEA_GEAR_BITS, ESEA_GEAR_BITS, 8u };
        const esea_angle_t angle = esea_biss_read(&gears[axis], &config, &hardware);

        measured[places[axis]] = (float)angle.count;
        measured[places[axis] + 1u] = (float)angle.frame_error;
    }
}
#endif

static void port_sample(float *measured)
{
    read_sides(measured);
#if ESEA_LINK_GEAR_ENCODERS > 0
    read_gears(measured);
#endif
    esea_stop_line_look(&stop_line, &stop_config, &hardware);
}
#endif

static void port_motor(const float *u_Nm, bool enable)
{
    uint32_t axis;

    for (axis = 0u; axis < axes; ++axis) {
        set_Nm[axis] = enable ? u_Nm[axis] : 0.0f;
        esea_escon_drive(&motors[axis], &motor_configs[axis], &hardware, u_Nm[axis], enable);
    }
}

static bool port_stop_open(void)
{
    return esea_stop_line_open(&stop_line, &stop_config, &hardware);
}

static uint32_t port_trouble(void)
{
    uint32_t axis, found = ESEA_FAULT_NONE;

    if (reset_by_watchdog) {
        reset_by_watchdog = false;
        return ESEA_FAULT_WATCHDOG;
    }
    if ((ESEA_PWR_CSR & ESEA_PWR_CSR_PVDO) != 0u)
        return ESEA_FAULT_BROWN_OUT;
    if (ESEA_LINK_AXES > 0u && ESEA_NEEDS_HZ > ESEA_RESET_HZ && !esea_board_fast())
        return ESEA_FAULT_SLOW_CLOCK;
    for (axis = 0u; axis < axes; ++axis)
        if (esea_escon_wrong(&motors[axis], &motor_configs[axis], &hardware, set_Nm[axis]))
            found = ESEA_FAULT_MOTOR_CURRENT;
    return found;
}

static void set_watchdog(uint32_t divider, uint32_t ticks)
{
    ESEA_IWDG_KR = ESEA_IWDG_KR_OPEN;
    ESEA_IWDG_PR = divider;
    ESEA_IWDG_RLR = ticks;
}

static void port_feed(void)
{
    if (!watched) {
        ESEA_IWDG_KR = ESEA_IWDG_KR_START;
        set_watchdog(ESEA_IWDG_PR_BY_16, WATCHDOG_TICKS);
        watched = true;
    }
    ESEA_IWDG_KR = ESEA_IWDG_KR_FEED;
}

void esea_board_patience(bool on)
{
    if (!watched)
        return;
    if (on)
        set_watchdog(ESEA_IWDG_PR_BY_64, 0xFFFu); /* 8 s, 5.6 at least; an erasure takes 2 */
    else
        set_watchdog(ESEA_IWDG_PR_BY_16, WATCHDOG_TICKS);
    (void)esea_board_until(ESEA_IWDG_SR, 0xFFFFFFFFu, 0u, 100u * PATIENCE); /* some of its own cycles */
    ESEA_IWDG_KR = ESEA_IWDG_KR_FEED;
}

static void set_mode(uint32_t pin, uint32_t mode, uint32_t function)
{
    const uint32_t port = pin / 16u, number = pin % 16u, nibble = 4u * (number % 8u);

    if (function == SPI_FUNCTION || function == SPI3_FUNCTION)
        ESEA_CHANGE(ESEA_GPIO_OSPEEDR(port), 3u << (2u * number), ESEA_GPIO_25MHZ << (2u * number));
    ESEA_CHANGE(ESEA_GPIO_AFR(port, number), 0xFu << nibble, function << nibble);
    ESEA_CHANGE(ESEA_GPIO_MODER(port), 3u << (2u * number), mode << (2u * number));
}

/* What selects stands high, what enables low, before they are outputs. */
static void start_axis(uint32_t axis)
{
    hw_put_pin(motor_sides[axis], true);
    hw_put_pin(load_sides[axis], true);
    hw_put_pin(enables[axis], false);
    set_mode(motor_sides[axis], ESEA_GPIO_OUTPUT, 0u);
    set_mode(load_sides[axis], ESEA_GPIO_OUTPUT, 0u);
    set_mode(enables[axis], ESEA_GPIO_OUTPUT, 0u);
}

static void start_pins(void)
{
    uint32_t number;

    start_axis(0u);
    ESEA_CHANGE(ESEA_GPIO_PUPDR(2u), 3u << 16, ESEA_GPIO_PULL_DOWN << 16); /* PC8: a wire that is off is open */
    for (number = 5u; number <= 7u; ++number)
        set_mode(PIN(0u, number), ESEA_GPIO_FUNCTION, SPI_FUNCTION);
    set_mode(BISS_1, ESEA_GPIO_FUNCTION, SPI_FUNCTION);
    set_mode(PIN(1u, 14u), ESEA_GPIO_FUNCTION, SPI_FUNCTION);
    set_mode(PIN(2u, 6u), ESEA_GPIO_FUNCTION, TIMER_FUNCTION);
    set_mode(PIN(2u, 0u), ESEA_GPIO_ANALOG, 0u);
    if (!SECOND_AXIS)
        return;
    start_axis(1u);
    set_mode(BISS_2, ESEA_GPIO_FUNCTION, SPI3_FUNCTION);
    set_mode(PIN(2u, 11u), ESEA_GPIO_FUNCTION, SPI3_FUNCTION);
    set_mode(PIN(2u, 9u), ESEA_GPIO_FUNCTION, TIMER_FUNCTION);
    set_mode(PIN(2u, 1u), ESEA_GPIO_ANALOG, 0u);
}

static void start_peripherals(void)
{
    const uint32_t master = ESEA_SPI_CR1_MSTR | ESEA_SPI_CR1_SSI | ESEA_SPI_CR1_SSM;
    const bool fast = esea_board_fast();
    /* 84 MHz by 16 and 42 by 8: 5.25 MHz, or 16 by 4: 4 MHz; both chips take 10. */
    const uint32_t one = master | (fast ? ESEA_SPI_CR1_BY_16 : ESEA_SPI_CR1_BY_4);
    const uint32_t two = master | (fast ? ESEA_SPI_CR1_BY_8 : ESEA_SPI_CR1_BY_4);

    /* AS5048A: read at the second edge.  BiSS: rests high, read at the falling edge, half a bit after the
     * encoder has put it. */
    ESEA_SPI_CR1(ESEA_SPI1) = one | ESEA_SPI_CR1_CPHA | ESEA_SPI_CR1_SPE;
    ESEA_SPI_CR1(ESEA_SPI2) = two | ESEA_SPI_CR1_CPOL | ESEA_SPI_CR1_SPE;
    if (SECOND_AXIS)
        ESEA_SPI_CR1(ESEA_SPI3) = two | ESEA_SPI_CR1_CPOL | ESEA_SPI_CR1_SPE;

    ESEA_TIM3_PSC = 0u;
    pwm_ticks = esea_board_bus_Hz() / PWM_HZ;
    ESEA_TIM3_ARR = pwm_ticks - 1u;
    ESEA_TIM3_CCR(1u) = pwm_ticks / 2u;
    ESEA_TIM3_CCR(4u) = pwm_ticks / 2u;
    ESEA_TIM3_CCMR1 = ESEA_TIM3_CCMR1_PWM_1;
    ESEA_TIM3_CCMR2 = SECOND_AXIS ? ESEA_TIM3_CCMR2_PWM_4 : 0u;
    ESEA_TIM3_CCER = ESEA_TIM3_CCER_1 | (SECOND_AXIS ? ESEA_TIM3_CCER_4 : 0u);
    ESEA_TIM3_EGR = 1u;
    ESEA_TIM3_CR1 = ESEA_TIM3_CR1_ARPE | ESEA_TIM3_CR1_CEN;

    /* 21 MHz and 84 cycles of channels 10 and 11, or 8 and 28: about 4 us; 36 MHz is the most. */
    ESEA_CHANGE(ESEA_ADC_CCR, 3u << 16, fast ? ESEA_ADC_CCR_BY_4 : 0u);
    ESEA_ADC1_SMPR1 = (fast ? 4u : 2u) * 9u;
    ESEA_ADC1_CR2 = ESEA_ADC1_CR2_ADON;

    ESEA_PWR_CR |= ESEA_PWR_CR_2V9 | ESEA_PWR_CR_PVDE;
    reset_by_watchdog = (ESEA_RCC_CSR & ESEA_RCC_CSR_IWDGRSTF) != 0u;
    ESEA_RCC_CSR |= ESEA_RCC_CSR_RMVF;
}

void esea_board_drivers(esea_port_t *port)
{
    uint32_t axis;

    ESEA_RCC_AHB1ENR |= ESEA_RCC_AHB1ENR_GPIOA | ESEA_RCC_AHB1ENR_GPIOB | ESEA_RCC_AHB1ENR_GPIOC;
    ESEA_RCC_APB1ENR |= ESEA_RCC_APB1ENR_TIM3 | ESEA_RCC_APB1ENR_SPI2 | ESEA_RCC_APB1ENR_PWR |
                        (SECOND_AXIS ? ESEA_RCC_APB1ENR_SPI3 : 0u);
    ESEA_RCC_APB2ENR |= ESEA_RCC_APB2ENR_SPI1 | ESEA_RCC_APB2ENR_ADC1;
    __asm__ volatile("dsb" ::: "memory");

    if (!esea_board_fast())
        port->notice = "clock: 16 MHz, the PLL did not lock";
    start_pins();
    /* Where pins do not keep their mode there are none, as in the emulator: without drivers every
     * measurement is NaN, and the board cannot be armed. */
    if ((ESEA_GPIO_MODER(2u) >> 14 & 3u) != ESEA_GPIO_OUTPUT)
        return;
    start_peripherals();
#if ESEA_LINK_MOTOR_ENCODERS > 0
    for (axis = 0u; axis < ESEA_LINK_MOTOR_ENCODERS; ++axis) {
        esea_as5048a_start(&sides[axis][0]);
        esea_as5048a_start(&sides[axis][1]);
    }
    port->sample = port_sample;
#endif
    for (axis = 0u; axis < AXES_MOST; ++axis)
        if (axis == 0u || SECOND_AXIS)
            esea_escon_start(&motors[axis], &motor_configs[axis], &hardware);

    port->flash = &esea_board_flash;
    port->trouble = port_trouble;
    port->feed = port_feed;
    if (axes == 0u)
        return;
    port->motor = port_motor;
    port->stop_open = port_stop_open;
}
