/* Telemetry streams: values of a task's runs, several runs a message.
 *
 * License: MIT. */
#include "app.h"

#include <string.h>

static esea_block_t *block_at(esea_stream_t *stream, uint32_t number)
{
    return &stream->blocks[number % ESEA_BLOCKS];
}

/* What was written is seen by whoever sees the number that follows. */
static void publish(volatile uint32_t *number, uint32_t value)
{
    __atomic_thread_fence(__ATOMIC_SEQ_CST);
    *number = value;
}

static void close_block(esea_stream_t *stream)
{
    block_at(stream, stream->head)->count = stream->count;
    stream->count = 0u;
    esea_count(&stream->filled);
    publish(&stream->head, stream->head + 1u);
}

/* The block that the next sample goes to; NULL while a message is left out. */
static esea_block_t *open_block(esea_stream_t *stream, uint32_t tick, uint64_t time)
{
    esea_block_t *block = block_at(stream, stream->head);

    if (stream->left_out > 0u) {
        --stream->left_out;
        return NULL;
    }
    /* Samples in a message follow one another: after a gap there begins another. */
    if (stream->count > 0u && tick - block->tick != stream->count * stream->interval) {
        close_block(stream);
        block = block_at(stream, stream->head);
    }
    if (stream->count > 0u)
        return block;
    if (stream->head - stream->tail >= ESEA_BLOCKS) {
        esea_count(&stream->dropped);
        stream->left_out = stream->samples - 1u;
        return NULL;
    }
    block->tick = tick;
    block->time = time;
    return block;
}

void esea_streams_take(esea_app_t *app, uint32_t task, uint32_t tick, uint64_t time, uint32_t step_ticks)
{
    uint32_t number;

    for (number = 0u; number < ESEA_LINK_STREAMS; ++number) {
        esea_stream_t *const stream = &app->streams[number];
        esea_block_t *block;

        if (stream->interval == 0u || stream->task != task || (tick - esea_link_phase(task)) % stream->interval != 0u)
            continue;
        block = open_block(stream, tick, time);
        if (block == NULL)
            continue;
        esea_link_sample(task, stream->signals, stream->width, &app->in[task], &app->out[task], step_ticks,
                &block->words[stream->count * stream->width]);
        if (++stream->count >= stream->samples)
            close_block(stream);
    }
}

bool esea_streams_wait(const esea_app_t *app)
{
    uint32_t number;

    for (number = 0u; number < ESEA_LINK_STREAMS; ++number)
        if (app->streams[number].tail != app->streams[number].head)
            return true;
    return false;
}

bool esea_streams_send(esea_app_t *app, uint32_t number)
{
    esea_stream_t *const stream = &app->streams[number];
    const esea_block_t *const block = block_at(stream, stream->tail);
    mavlink_esea_data_t fields;

    if (stream->tail == stream->head)
        return false;
    memset(&fields, 0, sizeof fields);
    fields.time = block->time;
    fields.sequence = block->tick;
    fields.interval = (uint16_t)stream->interval;
    fields.stream = (uint8_t)number;
    fields.choice = stream->choice;
    fields.count = (uint8_t)block->count;
    memcpy(fields.data, block->words, block->count * stream->width * sizeof block->words[0]);
    publish(&stream->tail, stream->tail + 1u);
    ESEA_SEND(app, esea_data, fields);
    return true;
}

static bool valid(const mavlink_esea_stream_t *fields)
{
    uint32_t i;

    if (fields->stream >= ESEA_LINK_STREAMS || fields->task >= ESEA_LINK_TASKS || fields->count > ESEA_LINK_STREAM_WORDS)
        return false;
    for (i = 0u; i < fields->count; ++i)
        if (fields->signals[i] >= esea_link_signals(fields->task))
            return false;
    return fields->interval == 0u || fields->count > 0u;
}

/* Base ticks, rounded up to whole runs of the task; the message has 16 bits for them. */
static uint32_t rounded(uint32_t task, uint32_t interval)
{
    const uint32_t every = esea_link_every(task);
    const uint32_t ticks = (interval + every - 1u) / every * every;

    return ticks <= UINT16_MAX ? ticks : UINT16_MAX / every * every;
}

static void choose(esea_app_t *app, mavlink_esea_stream_t *fields)
{
    esea_stream_t *const stream = &app->streams[fields->stream];
    const uint32_t filled = stream->filled, dropped = stream->dropped;
    uint32_t fit, span;

    app->port->quiet(true);
    memset(stream, 0, sizeof *stream);
    stream->filled = filled;
    stream->dropped = dropped;
    stream->choice = fields->choice;
    if (fields->interval > 0u) {
        stream->task = fields->task;
        stream->width = fields->count;
        memcpy(stream->signals, fields->signals, sizeof stream->signals);
        fields->interval = (uint16_t)rounded(fields->task, fields->interval);
        fit = ESEA_LINK_STREAM_WORDS / stream->width;
        span = esea_ticks(ESEA_LINK_STREAM_SPAN_MS) / fields->interval;
        stream->samples = span < 1u ? 1u : span < fit ? span : fit;
        stream->interval = fields->interval; /* last: with it the stream runs */
    }
    app->port->quiet(false);
    fields->samples = (uint8_t)stream->samples;
}

void esea_streams_choose(esea_app_t *app, const mavlink_message_t *message)
{
    mavlink_esea_stream_t fields;

    mavlink_msg_esea_stream_decode(message, &fields);
    fields.samples = 0u;
    fields.result = (uint8_t)(valid(&fields) ? MAV_RESULT_ACCEPTED : MAV_RESULT_DENIED);
    if (fields.result == MAV_RESULT_ACCEPTED)
        choose(app, &fields);
    ESEA_SEND(app, esea_stream, fields);
}
