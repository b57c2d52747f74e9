/* License: MIT. */
#include "guests.h"

#include <errno.h>
#include <sys/socket.h>
#include <unistd.h>

#define STAY_US 1000000u
#define MOST_BYTES 4096u

typedef struct {
    bool here;
    int file;
    uint64_t end_us;
    size_t count; /* of bytes that came */
    esea_guest_t guest;
} place_t;

static place_t places[GUESTS_MOST];

static void answer(place_t *place)
{
    /* As far as it fits: nobody waits for a guest. */
    (void)send(place->file, place->guest.answer, place->guest.answered, MSG_DONTWAIT | MSG_NOSIGNAL);
    place->guest.answered = 0u;
}

static void let_go(place_t *place)
{
    (void)close(place->file);
    place->here = false;
}

static void listen_to(esea_app_t *app, place_t *place, uint64_t now_us)
{
    uint8_t bytes[512];
    const ssize_t n = recv(place->file, bytes, sizeof bytes, MSG_DONTWAIT);
    const size_t count = n > 0 ? (size_t)n : 0u;
    const bool last = n == 0 || (n < 0 && errno != EAGAIN && errno != EINTR) || place->count > MOST_BYTES ||
                      now_us > place->end_us;

    place->count += count;
    esea_app_overhear(app, &place->guest, bytes, count, last);
    answer(place);
    if (last)
        let_go(place);
}

void guests_admit(esea_app_t *app, int file, const char *commander, uint64_t now_us)
{
    place_t *place = &places[0];
    uint32_t i;

    for (i = 1u; i < GUESTS_MOST; ++i)
        if (place->here && (!places[i].here || places[i].end_us < place->end_us))
            place = &places[i];
    if (place->here) { /* all are taken: who came first has been heard */
        listen_to(app, place, now_us);
        if (place->here)
            let_go(place);
    }
    place->here = true;
    place->file = file;
    place->end_us = now_us + STAY_US;
    place->count = 0u;
    esea_app_greet(app, &place->guest, commander);
    answer(place);
    listen_to(app, place, now_us);
}

void guests_attend(esea_app_t *app, uint32_t number, uint64_t now_us)
{
    if (places[number].here)
        listen_to(app, &places[number], now_us);
}
