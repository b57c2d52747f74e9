/* License: MIT. */
#include "line.h"

#include <arpa/inet.h>
#include <errno.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <termios.h>
#include <unistd.h>

/* A whole number up to `most`; -1 for anything else. */
static long number(const char *text, long most)
{
    char *end;
    const long value = strtol(text, &end, 10);

    return *text != '\0' && *end == '\0' && value >= 0 && value <= most ? value : -1;
}

static bool open_tcp(line_t *line, const char *where)
{
    const char *const colon = strrchr(where, ':');
    const long port = number(colon != NULL ? colon + 1 : where, 65535);
    struct sockaddr_in at;
    socklen_t size = sizeof at;
    char host[INET_ADDRSTRLEN] = "127.0.0.1";
    const int yes = 1;

    errno = EINVAL;
    if (colon != NULL) {
        if ((size_t)(colon - where) >= sizeof host)
            return false;
        memset(host, 0, sizeof host);
        memcpy(host, where, (size_t)(colon - where));
    }
    memset(&at, 0, sizeof at);
    at.sin_family = AF_INET;
    at.sin_port = htons((uint16_t)port);
    if (port < 0 || inet_pton(AF_INET, host, &at.sin_addr) != 1)
        return false;
    line->listener = socket(AF_INET, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
    (void)setsockopt(line->listener, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
    if (bind(line->listener, (struct sockaddr *)&at, sizeof at) != 0 || listen(line->listener, 16) != 0 ||
        getsockname(line->listener, (struct sockaddr *)&at, &size) != 0)
        return false;
    fprintf(stderr, "listens at tcp:%s:%u\n", host, ntohs(at.sin_port));
    return true;
}

static speed_t speed_of(long baud)
{
    static const struct {
        long baud;
        speed_t speed;
    } known[] = { { 9600, B9600 }, { 57600, B57600 }, { 115200, B115200 }, { 230400, B230400 }, { 460800, B460800 },
        { 921600, B921600 }, { 1000000, B1000000 }, { 3000000, B3000000 } };
    size_t i;

    for (i = 0u; i < sizeof known / sizeof known[0]; ++i)
        if (known[i].baud == baud)
            return known[i].speed;
    return B0;
}

/* Bytes as they are; a terminal's speed does nothing where there is no wire. */
static bool make_raw(int file, speed_t speed)
{
    struct termios settings;

    if (tcgetattr(file, &settings) != 0)
        return false;
    cfmakeraw(&settings);
    return cfsetspeed(&settings, speed) == 0 && tcsetattr(file, TCSANOW, &settings) == 0;
}

static bool open_serial(line_t *line, const char *where)
{
    const char *const colon = strrchr(where, ':');
    const long baud = colon != NULL ? number(colon + 1, 3000000) : 115200;
    const size_t length = colon != NULL ? (size_t)(colon - where) : strlen(where);
    char name[256];

    errno = EINVAL;
    if (length >= sizeof name || baud < 0 || speed_of(baud) == B0)
        return false;
    memcpy(name, where, length);
    name[length] = '\0';
    line->in = line->out = open(name, O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
    /* What waited there from before is not taken. */
    return line->in >= 0 && make_raw(line->in, speed_of(baud)) && tcflush(line->in, TCIOFLUSH) == 0;
}

static bool open_pty(line_t *line)
{
    const int ours = posix_openpt(O_RDWR | O_NOCTTY);
    int theirs;

    if (ours < 0 || grantpt(ours) != 0 || unlockpt(ours) != 0 || fcntl(ours, F_SETFL, O_NONBLOCK) != 0)
        return false;
    theirs = open(ptsname(ours), O_RDWR | O_NOCTTY); /* stays open: a host may come and go */
    if (theirs < 0 || !make_raw(theirs, B115200))
        return false;
    line->in = line->out = ours;
    fprintf(stderr, "listens at pty:%s\n", ptsname(ours));
    return true;
}

bool line_open(line_t *line, const char *address)
{
    memset(line, 0, sizeof *line);
    line->in = line->out = line->listener = -1;
    line->live = strcmp(address, "stdio") != 0;
    if (!line->live) {
        line->in = STDIN_FILENO;
        line->out = STDOUT_FILENO;
        return fcntl(line->in, F_SETFL, O_NONBLOCK) == 0;
    }
    if (strncmp(address, "tcp:", 4) == 0)
        return open_tcp(line, address + 4);
    if (strncmp(address, "serial:", 7) == 0)
        return open_serial(line, address + 7);
    errno = EINVAL;
    return strcmp(address, "pty") == 0 && open_pty(line);
}

nfds_t line_files(const line_t *line, bool to_read, bool to_write, struct pollfd *files)
{
    const bool nobody = line->in < 0;

    files[0].fd = nobody ? line->listener : line->in;
    files[0].events = to_read ? POLLIN : 0;
    files[1].fd = to_write ? line->out : -1;
    files[1].events = POLLOUT;
    return 2u;
}

static void hang_up(line_t *line)
{
    if (line->listener >= 0 && line->in >= 0)
        (void)close(line->in);
    line->over = line->over || !line->live;
    if (line->listener >= 0)
        line->in = line->out = -1;
}

static bool has(int of, short event)
{
    struct pollfd file = { of, event, 0 };

    return poll(&file, 1u, 0) > 0;
}

int line_accept(line_t *line)
{
    const int yes = 1, room = 65536; /* a tenth of a second of everything: no more is old when it comes */
    const int idle_s = 2, again_s = 1, tries = 3; /* until who went without a word is given up */
    struct sockaddr_in from;
    socklen_t size = sizeof from;
    char host[INET_ADDRSTRLEN] = "";
    int made;

    /* In this order: who is seen only after the host has left is the next host, once its last word has been read. */
    if (line->listener < 0 || (line->in >= 0 && (!has(line->listener, POLLIN) || has(line->in, POLLRDHUP))))
        return -1;
    made = accept4(line->listener, (struct sockaddr *)&from, &size, SOCK_NONBLOCK | SOCK_CLOEXEC);
    if (made < 0 || line->in >= 0)
        return made;
    line->in = line->out = made;
    (void)inet_ntop(AF_INET, &from.sin_addr, host, sizeof host);
    (void)snprintf(line->host, sizeof line->host, "%s:%u", host, (unsigned)ntohs(from.sin_port));
    (void)setsockopt(made, IPPROTO_TCP, TCP_NODELAY, &yes, sizeof yes);
    (void)setsockopt(made, SOL_SOCKET, SO_SNDBUF, &room, sizeof room);
    (void)setsockopt(made, SOL_SOCKET, SO_KEEPALIVE, &yes, sizeof yes);
    (void)setsockopt(made, IPPROTO_TCP, TCP_KEEPIDLE, &idle_s, sizeof idle_s);
    (void)setsockopt(made, IPPROTO_TCP, TCP_KEEPINTVL, &again_s, sizeof again_s);
    (void)setsockopt(made, IPPROTO_TCP, TCP_KEEPCNT, &tries, sizeof tries);
    return -1;
}

size_t line_read(line_t *line, uint8_t *bytes, size_t capacity)
{
    const ssize_t n = line->in >= 0 ? read(line->in, bytes, capacity) : 0;

    if (n > 0)
        return (size_t)n;
    if (line->in >= 0 && (n == 0 || (errno != EAGAIN && errno != EINTR)))
        hang_up(line);
    return 0u;
}

size_t line_write(line_t *line, const uint8_t *bytes, size_t count)
{
    const ssize_t n = line->out >= 0 ? write(line->out, bytes, count) : 0;

    if (n > 0) {
        line->deaf = false;
        return (size_t)n;
    }
    if (n < 0 && errno != EAGAIN && errno != EINTR)
        hang_up(line);
    return 0u;
}

void line_deaf(line_t *line)
{
    if (line->listener >= 0)
        hang_up(line);
    else
        line->deaf = line->live;
}
