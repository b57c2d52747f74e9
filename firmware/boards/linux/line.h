/* The line of a board with Linux: standard input and output, a terminal, or one TCP connection at a time.
 *
 * License: MIT. */
#ifndef ESEA_LINE_H
#define ESEA_LINE_H

#include <fcntl.h>
#include <poll.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

typedef struct {
    int in, out;  /* below 0: nobody is there */
    int listener; /* below 0: no TCP */
    bool live;    /* whether the board has a clock of its own on it */
    bool over;    /* standard input has ended */
    bool deaf;    /* a terminal that nobody reads */
    char host[22]; /* address and port of who is there */
} line_t;

/* False with errno: not to be had. */
bool line_open(line_t *line, const char *address);

/* What to wait for, at most two. */
nfds_t line_files(const line_t *line, bool to_read, bool to_write, struct pollfd *files);

/* Takes a host that wants in, where there is none.  Where there is one: somebody else's connection, below 0 for
 * nobody's. */
int line_accept(line_t *line);

/* Neither waits. */
size_t line_read(line_t *line, uint8_t *bytes, size_t capacity);
size_t line_write(line_t *line, const uint8_t *bytes, size_t count);

/* The host takes nothing: a connection is closed, a terminal not waited for until it takes again. */
void line_deaf(line_t *line);

static inline bool line_gone(const line_t *line)
{
    return line->out < 0 || line->deaf;
}

static inline bool line_live(const line_t *line)
{
    return line->live;
}

static inline bool line_over(const line_t *line)
{
    return line->over;
}

#endif
