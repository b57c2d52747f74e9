/* The host as a board: frames on standard input and output.  For tests of the application with
 * sanitizers, and for trying the link without an emulator.  It has no clock of its own: it only
 * replays, and `sim` has one.
 *
 * License: MIT. */
#include <unistd.h>

#include "app.h"
#include "port.h"

static struct {
    uint8_t bytes[1024];
    size_t count, taken;
    bool closed;
} receiver;

static size_t port_read(uint8_t *bytes, size_t capacity)
{
    size_t n = 0u;

    while (n < capacity && receiver.taken < receiver.count)
        bytes[n++] = receiver.bytes[receiver.taken++];
    return n;
}

static void port_write(const uint8_t *bytes, size_t count)
{
    while (count > 0u) {
        const ssize_t n = write(STDOUT_FILENO, bytes, count);

        if (n <= 0) {
            receiver.closed = true;
            return;
        }
        bytes += n;
        count -= (size_t)n;
    }
}

static void port_wait(void)
{
    const ssize_t n = read(STDIN_FILENO, receiver.bytes, sizeof receiver.bytes);

    receiver.taken = 0u;
    receiver.count = n > 0 ? (size_t)n : 0u;
    receiver.closed = receiver.closed || n <= 0;
}

static uint32_t port_zero(void)
{
    return 0u;
}

static void port_quiet(bool on)
{
    (void)on;
}

static void port_nothing(void)
{
}

/* A first argument stands for a stack that is used up. */
static uint32_t port_stack_full(void)
{
    return 1u;
}

int main(int argc, char **argv)
{
    static esea_app_t app;
    const esea_port_t port = {
        .name = "host",
        .receive_buffer_bytes = 65536u, /* of the pipe */
        .stack_bytes = 1u,              /* the system's; not measured */
        .read = port_read,
        .write = port_write,
        .wait = port_wait,
        .ticks = port_zero,
        .quiet = port_quiet,
        .pend = port_nothing,
        .lost_bytes = port_zero,
        .stack_peak_bytes = argc > 1 ? port_stack_full : port_zero,
    };

    (void)argv;
    esea_app_init(&app, &port);
    while (!receiver.closed)
        esea_app_poll(&app);
    return 0;
}
