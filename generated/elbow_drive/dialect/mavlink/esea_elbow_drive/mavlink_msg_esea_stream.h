#pragma once
// MESSAGE ESEA_STREAM PACKING

#include <stdint.h>

#define MAVLINK_MSG_ID_ESEA_STREAM 42662


typedef struct __mavlink_esea_stream_t {
 uint16_t interval; /*<  Base ticks from one sample to the next; 0: no more.*/
 uint8_t stream; /*<  Number of the stream, below 6.*/
 uint8_t task; /*<  Number of the task whose runs are sampled.*/
 uint8_t choice; /*<  Any number, to tell samples of this choice by.*/
 uint8_t count; /*<  Values in a sample.*/
 uint8_t samples; /*<  In the answer: samples that a message holds.*/
 uint8_t result; /*<  In the answer: what became of it.*/
 uint8_t signals[59]; /*<  What is sampled, by number: the values of the task's IN message, element by element, then those of its OUT message, both without the sequence.*/
} mavlink_esea_stream_t;

#define MAVLINK_MSG_ID_ESEA_STREAM_LEN 67
#define MAVLINK_MSG_ID_ESEA_STREAM_MIN_LEN 67
#define MAVLINK_MSG_ID_42662_LEN 67
#define MAVLINK_MSG_ID_42662_MIN_LEN 67

#define MAVLINK_MSG_ID_ESEA_STREAM_CRC 182
#define MAVLINK_MSG_ID_42662_CRC 182

#define MAVLINK_MSG_ESEA_STREAM_FIELD_SIGNALS_LEN 59

#if MAVLINK_COMMAND_24BIT
#define MAVLINK_MESSAGE_INFO_ESEA_STREAM { \
    42662, \
    "ESEA_STREAM", \
    8, \
    {  { "interval", NULL, MAVLINK_TYPE_UINT16_T, 0, 0, offsetof(mavlink_esea_stream_t, interval) }, \
         { "stream", NULL, MAVLINK_TYPE_UINT8_T, 0, 2, offsetof(mavlink_esea_stream_t, stream) }, \
         { "task", NULL, MAVLINK_TYPE_UINT8_T, 0, 3, offsetof(mavlink_esea_stream_t, task) }, \
         { "choice", NULL, MAVLINK_TYPE_UINT8_T, 0, 4, offsetof(mavlink_esea_stream_t, choice) }, \
         { "count", NULL, MAVLINK_TYPE_UINT8_T, 0, 5, offsetof(mavlink_esea_stream_t, count) }, \
         { "samples", NULL, MAVLINK_TYPE_UINT8_T, 0, 6, offsetof(mavlink_esea_stream_t, samples) }, \
         { "result", NULL, MAVLINK_TYPE_UINT8_T, 0, 7, offsetof(mavlink_esea_stream_t, result) }, \
         { "signals", NULL, MAVLINK_TYPE_UINT8_T, 59, 8, offsetof(mavlink_esea_stream_t, signals) }, \
         } \
}
#else
#define MAVLINK_MESSAGE_INFO_ESEA_STREAM { \
    "ESEA_STREAM", \
    8, \
    {  { "interval", NULL, MAVLINK_TYPE_UINT16_T, 0, 0, offsetof(mavlink_esea_stream_t, interval) }, \
         { "stream", NULL, MAVLINK_TYPE_UINT8_T, 0, 2, offsetof(mavlink_esea_stream_t, stream) }, \
         { "task", NULL, MAVLINK_TYPE_UINT8_T, 0, 3, offsetof(mavlink_esea_stream_t, task) }, \
         { "choice", NULL, MAVLINK_TYPE_UINT8_T, 0, 4, offsetof(mavlink_esea_stream_t, choice) }, \
         { "count", NULL, MAVLINK_TYPE_UINT8_T, 0, 5, offsetof(mavlink_esea_stream_t, count) }, \
         { "samples", NULL, MAVLINK_TYPE_UINT8_T, 0, 6, offsetof(mavlink_esea_stream_t, samples) }, \
         { "result", NULL, MAVLINK_TYPE_UINT8_T, 0, 7, offsetof(mavlink_esea_stream_t, result) }, \
         { "signals", NULL, MAVLINK_TYPE_UINT8_T, 59, 8, offsetof(mavlink_esea_stream_t, signals) }, \
         } \
}
#endif

/**
 * @brief Pack a esea_stream message
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param msg The MAVLink message to compress the data into
 *
 * @param interval  Base ticks from one sample to the next; 0: no more.
 * @param stream  Number of the stream, below 6.
 * @param task  Number of the task whose runs are sampled.
 * @param choice  Any number, to tell samples of this choice by.
 * @param count  Values in a sample.
 * @param samples  In the answer: samples that a message holds.
 * @param result  In the answer: what became of it.
 * @param signals  What is sampled, by number: the values of the task's IN message, element by element, then those of its OUT message, both without the sequence.
 * @return length of the message in bytes (excluding serial stream start sign)
 */
static inline uint16_t mavlink_msg_esea_stream_pack(uint8_t system_id, uint8_t component_id, mavlink_message_t* msg,
                               uint16_t interval, uint8_t stream, uint8_t task, uint8_t choice, uint8_t count, uint8_t samples, uint8_t result, const uint8_t *signals)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    char buf[MAVLINK_MSG_ID_ESEA_STREAM_LEN];
    _mav_put_uint16_t(buf, 0, interval);
    _mav_put_uint8_t(buf, 2, stream);
    _mav_put_uint8_t(buf, 3, task);
    _mav_put_uint8_t(buf, 4, choice);
    _mav_put_uint8_t(buf, 5, count);
    _mav_put_uint8_t(buf, 6, samples);
    _mav_put_uint8_t(buf, 7, result);
    _mav_put_uint8_t_array(buf, 8, signals, 59);
        memcpy(_MAV_PAYLOAD_NON_CONST(msg), buf, MAVLINK_MSG_ID_ESEA_STREAM_LEN);
#else
    mavlink_esea_stream_t packet;
    packet.interval = interval;
    packet.stream = stream;
    packet.task = task;
    packet.choice = choice;
    packet.count = count;
    packet.samples = samples;
    packet.result = result;
    mav_array_memcpy(packet.signals, signals, sizeof(uint8_t)*59);
        memcpy(_MAV_PAYLOAD_NON_CONST(msg), &packet, MAVLINK_MSG_ID_ESEA_STREAM_LEN);
#endif

    msg->msgid = MAVLINK_MSG_ID_ESEA_STREAM;
    return mavlink_finalize_message(msg, system_id, component_id, MAVLINK_MSG_ID_ESEA_STREAM_MIN_LEN, MAVLINK_MSG_ID_ESEA_STREAM_LEN, MAVLINK_MSG_ID_ESEA_STREAM_CRC);
}

/**
 * @brief Pack a esea_stream message
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param status MAVLink status structure
 * @param msg The MAVLink message to compress the data into
 *
 * @param interval  Base ticks from one sample to the next; 0: no more.
 * @param stream  Number of the stream, below 6.
 * @param task  Number of the task whose runs are sampled.
 * @param choice  Any number, to tell samples of this choice by.
 * @param count  Values in a sample.
 * @param samples  In the answer: samples that a message holds.
 * @param result  In the answer: what became of it.
 * @param signals  What is sampled, by number: the values of the task's IN message, element by element, then those of its OUT message, both without the sequence.
 * @return length of the message in bytes (excluding serial stream start sign)
 */
static inline uint16_t mavlink_msg_esea_stream_pack_status(uint8_t system_id, uint8_t component_id, mavlink_status_t *_status, mavlink_message_t* msg,
                               uint16_t interval, uint8_t stream, uint8_t task, uint8_t choice, uint8_t count, uint8_t samples, uint8_t result, const uint8_t *signals)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    char buf[MAVLINK_MSG_ID_ESEA_STREAM_LEN];
    _mav_put_uint16_t(buf, 0, interval);
    _mav_put_uint8_t(buf, 2, stream);
    _mav_put_uint8_t(buf, 3, task);
    _mav_put_uint8_t(buf, 4, choice);
    _mav_put_uint8_t(buf, 5, count);
    _mav_put_uint8_t(buf, 6, samples);
    _mav_put_uint8_t(buf, 7, result);
    _mav_put_uint8_t_array(buf, 8, signals, 59);
        memcpy(_MAV_PAYLOAD_NON_CONST(msg), buf, MAVLINK_MSG_ID_ESEA_STREAM_LEN);
#else
    mavlink_esea_stream_t packet;
    packet.interval = interval;
    packet.stream = stream;
    packet.task = task;
    packet.choice = choice;
    packet.count = count;
    packet.samples = samples;
    packet.result = result;
    mav_array_memcpy(packet.signals, signals, sizeof(uint8_t)*59);
        memcpy(_MAV_PAYLOAD_NON_CONST(msg), &packet, MAVLINK_MSG_ID_ESEA_STREAM_LEN);
#endif

    msg->msgid = MAVLINK_MSG_ID_ESEA_STREAM;
#if MAVLINK_CRC_EXTRA
    return mavlink_finalize_message_buffer(msg, system_id, component_id, _status, MAVLINK_MSG_ID_ESEA_STREAM_MIN_LEN, MAVLINK_MSG_ID_ESEA_STREAM_LEN, MAVLINK_MSG_ID_ESEA_STREAM_CRC);
#else
    return mavlink_finalize_message_buffer(msg, system_id, component_id, _status, MAVLINK_MSG_ID_ESEA_STREAM_MIN_LEN, MAVLINK_MSG_ID_ESEA_STREAM_LEN);
#endif
}

/**
 * @brief Pack a esea_stream message on a channel
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param chan The MAVLink channel this message will be sent over
 * @param msg The MAVLink message to compress the data into
 * @param interval  Base ticks from one sample to the next; 0: no more.
 * @param stream  Number of the stream, below 6.
 * @param task  Number of the task whose runs are sampled.
 * @param choice  Any number, to tell samples of this choice by.
 * @param count  Values in a sample.
 * @param samples  In the answer: samples that a message holds.
 * @param result  In the answer: what became of it.
 * @param signals  What is sampled, by number: the values of the task's IN message, element by element, then those of its OUT message, both without the sequence.
 * @return length of the message in bytes (excluding serial stream start sign)
 */
static inline uint16_t mavlink_msg_esea_stream_pack_chan(uint8_t system_id, uint8_t component_id, uint8_t chan,
                               mavlink_message_t* msg,
                                   uint16_t interval,uint8_t stream,uint8_t task,uint8_t choice,uint8_t count,uint8_t samples,uint8_t result,const uint8_t *signals)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    char buf[MAVLINK_MSG_ID_ESEA_STREAM_LEN];
    _mav_put_uint16_t(buf, 0, interval);
    _mav_put_uint8_t(buf, 2, stream);
    _mav_put_uint8_t(buf, 3, task);
    _mav_put_uint8_t(buf, 4, choice);
    _mav_put_uint8_t(buf, 5, count);
    _mav_put_uint8_t(buf, 6, samples);
    _mav_put_uint8_t(buf, 7, result);
    _mav_put_uint8_t_array(buf, 8, signals, 59);
        memcpy(_MAV_PAYLOAD_NON_CONST(msg), buf, MAVLINK_MSG_ID_ESEA_STREAM_LEN);
#else
    mavlink_esea_stream_t packet;
    packet.interval = interval;
    packet.stream = stream;
    packet.task = task;
    packet.choice = choice;
    packet.count = count;
    packet.samples = samples;
    packet.result = result;
    mav_array_memcpy(packet.signals, signals, sizeof(uint8_t)*59);
        memcpy(_MAV_PAYLOAD_NON_CONST(msg), &packet, MAVLINK_MSG_ID_ESEA_STREAM_LEN);
#endif

    msg->msgid = MAVLINK_MSG_ID_ESEA_STREAM;
    return mavlink_finalize_message_chan(msg, system_id, component_id, chan, MAVLINK_MSG_ID_ESEA_STREAM_MIN_LEN, MAVLINK_MSG_ID_ESEA_STREAM_LEN, MAVLINK_MSG_ID_ESEA_STREAM_CRC);
}

/**
 * @brief Encode a esea_stream struct
 *
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param msg The MAVLink message to compress the data into
 * @param esea_stream C-struct to read the message contents from
 */
static inline uint16_t mavlink_msg_esea_stream_encode(uint8_t system_id, uint8_t component_id, mavlink_message_t* msg, const mavlink_esea_stream_t* esea_stream)
{
    return mavlink_msg_esea_stream_pack(system_id, component_id, msg, esea_stream->interval, esea_stream->stream, esea_stream->task, esea_stream->choice, esea_stream->count, esea_stream->samples, esea_stream->result, esea_stream->signals);
}

/**
 * @brief Encode a esea_stream struct on a channel
 *
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param chan The MAVLink channel this message will be sent over
 * @param msg The MAVLink message to compress the data into
 * @param esea_stream C-struct to read the message contents from
 */
static inline uint16_t mavlink_msg_esea_stream_encode_chan(uint8_t system_id, uint8_t component_id, uint8_t chan, mavlink_message_t* msg, const mavlink_esea_stream_t* esea_stream)
{
    return mavlink_msg_esea_stream_pack_chan(system_id, component_id, chan, msg, esea_stream->interval, esea_stream->stream, esea_stream->task, esea_stream->choice, esea_stream->count, esea_stream->samples, esea_stream->result, esea_stream->signals);
}

/**
 * @brief Encode a esea_stream struct with provided status structure
 *
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param status MAVLink status structure
 * @param msg The MAVLink message to compress the data into
 * @param esea_stream C-struct to read the message contents from
 */
static inline uint16_t mavlink_msg_esea_stream_encode_status(uint8_t system_id, uint8_t component_id, mavlink_status_t* _status, mavlink_message_t* msg, const mavlink_esea_stream_t* esea_stream)
{
    return mavlink_msg_esea_stream_pack_status(system_id, component_id, _status, msg,  esea_stream->interval, esea_stream->stream, esea_stream->task, esea_stream->choice, esea_stream->count, esea_stream->samples, esea_stream->result, esea_stream->signals);
}

/**
 * @brief Send a esea_stream message
 * @param chan MAVLink channel to send the message
 *
 * @param interval  Base ticks from one sample to the next; 0: no more.
 * @param stream  Number of the stream, below 6.
 * @param task  Number of the task whose runs are sampled.
 * @param choice  Any number, to tell samples of this choice by.
 * @param count  Values in a sample.
 * @param samples  In the answer: samples that a message holds.
 * @param result  In the answer: what became of it.
 * @param signals  What is sampled, by number: the values of the task's IN message, element by element, then those of its OUT message, both without the sequence.
 */
#ifdef MAVLINK_USE_CONVENIENCE_FUNCTIONS

static inline void mavlink_msg_esea_stream_send(mavlink_channel_t chan, uint16_t interval, uint8_t stream, uint8_t task, uint8_t choice, uint8_t count, uint8_t samples, uint8_t result, const uint8_t *signals)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    char buf[MAVLINK_MSG_ID_ESEA_STREAM_LEN];
    _mav_put_uint16_t(buf, 0, interval);
    _mav_put_uint8_t(buf, 2, stream);
    _mav_put_uint8_t(buf, 3, task);
    _mav_put_uint8_t(buf, 4, choice);
    _mav_put_uint8_t(buf, 5, count);
    _mav_put_uint8_t(buf, 6, samples);
    _mav_put_uint8_t(buf, 7, result);
    _mav_put_uint8_t_array(buf, 8, signals, 59);
    _mav_finalize_message_chan_send(chan, MAVLINK_MSG_ID_ESEA_STREAM, buf, MAVLINK_MSG_ID_ESEA_STREAM_MIN_LEN, MAVLINK_MSG_ID_ESEA_STREAM_LEN, MAVLINK_MSG_ID_ESEA_STREAM_CRC);
#else
    mavlink_esea_stream_t packet;
    packet.interval = interval;
    packet.stream = stream;
    packet.task = task;
    packet.choice = choice;
    packet.count = count;
    packet.samples = samples;
    packet.result = result;
    mav_array_memcpy(packet.signals, signals, sizeof(uint8_t)*59);
    _mav_finalize_message_chan_send(chan, MAVLINK_MSG_ID_ESEA_STREAM, (const char *)&packet, MAVLINK_MSG_ID_ESEA_STREAM_MIN_LEN, MAVLINK_MSG_ID_ESEA_STREAM_LEN, MAVLINK_MSG_ID_ESEA_STREAM_CRC);
#endif
}

/**
 * @brief Send a esea_stream message
 * @param chan MAVLink channel to send the message
 * @param struct The MAVLink struct to serialize
 */
static inline void mavlink_msg_esea_stream_send_struct(mavlink_channel_t chan, const mavlink_esea_stream_t* esea_stream)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    mavlink_msg_esea_stream_send(chan, esea_stream->interval, esea_stream->stream, esea_stream->task, esea_stream->choice, esea_stream->count, esea_stream->samples, esea_stream->result, esea_stream->signals);
#else
    _mav_finalize_message_chan_send(chan, MAVLINK_MSG_ID_ESEA_STREAM, (const char *)esea_stream, MAVLINK_MSG_ID_ESEA_STREAM_MIN_LEN, MAVLINK_MSG_ID_ESEA_STREAM_LEN, MAVLINK_MSG_ID_ESEA_STREAM_CRC);
#endif
}

#if MAVLINK_MSG_ID_ESEA_STREAM_LEN <= MAVLINK_MAX_PAYLOAD_LEN
/*
  This variant of _send() can be used to save stack space by reusing
  memory from the receive buffer.  The caller provides a
  mavlink_message_t which is the size of a full mavlink message. This
  is usually the receive buffer for the channel, and allows a reply to an
  incoming message with minimum stack space usage.
 */
static inline void mavlink_msg_esea_stream_send_buf(mavlink_message_t *msgbuf, mavlink_channel_t chan,  uint16_t interval, uint8_t stream, uint8_t task, uint8_t choice, uint8_t count, uint8_t samples, uint8_t result, const uint8_t *signals)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    char *buf = (char *)msgbuf;
    _mav_put_uint16_t(buf, 0, interval);
    _mav_put_uint8_t(buf, 2, stream);
    _mav_put_uint8_t(buf, 3, task);
    _mav_put_uint8_t(buf, 4, choice);
    _mav_put_uint8_t(buf, 5, count);
    _mav_put_uint8_t(buf, 6, samples);
    _mav_put_uint8_t(buf, 7, result);
    _mav_put_uint8_t_array(buf, 8, signals, 59);
    _mav_finalize_message_chan_send(chan, MAVLINK_MSG_ID_ESEA_STREAM, buf, MAVLINK_MSG_ID_ESEA_STREAM_MIN_LEN, MAVLINK_MSG_ID_ESEA_STREAM_LEN, MAVLINK_MSG_ID_ESEA_STREAM_CRC);
#else
    mavlink_esea_stream_t *packet = (mavlink_esea_stream_t *)msgbuf;
    packet->interval = interval;
    packet->stream = stream;
    packet->task = task;
    packet->choice = choice;
    packet->count = count;
    packet->samples = samples;
    packet->result = result;
    mav_array_memcpy(packet->signals, signals, sizeof(uint8_t)*59);
    _mav_finalize_message_chan_send(chan, MAVLINK_MSG_ID_ESEA_STREAM, (const char *)packet, MAVLINK_MSG_ID_ESEA_STREAM_MIN_LEN, MAVLINK_MSG_ID_ESEA_STREAM_LEN, MAVLINK_MSG_ID_ESEA_STREAM_CRC);
#endif
}
#endif

#endif

// MESSAGE ESEA_STREAM UNPACKING


/**
 * @brief Get field interval from esea_stream message
 *
 * @return  Base ticks from one sample to the next; 0: no more.
 */
static inline uint16_t mavlink_msg_esea_stream_get_interval(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint16_t(msg,  0);
}

/**
 * @brief Get field stream from esea_stream message
 *
 * @return  Number of the stream, below 6.
 */
static inline uint8_t mavlink_msg_esea_stream_get_stream(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint8_t(msg,  2);
}

/**
 * @brief Get field task from esea_stream message
 *
 * @return  Number of the task whose runs are sampled.
 */
static inline uint8_t mavlink_msg_esea_stream_get_task(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint8_t(msg,  3);
}

/**
 * @brief Get field choice from esea_stream message
 *
 * @return  Any number, to tell samples of this choice by.
 */
static inline uint8_t mavlink_msg_esea_stream_get_choice(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint8_t(msg,  4);
}

/**
 * @brief Get field count from esea_stream message
 *
 * @return  Values in a sample.
 */
static inline uint8_t mavlink_msg_esea_stream_get_count(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint8_t(msg,  5);
}

/**
 * @brief Get field samples from esea_stream message
 *
 * @return  In the answer: samples that a message holds.
 */
static inline uint8_t mavlink_msg_esea_stream_get_samples(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint8_t(msg,  6);
}

/**
 * @brief Get field result from esea_stream message
 *
 * @return  In the answer: what became of it.
 */
static inline uint8_t mavlink_msg_esea_stream_get_result(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint8_t(msg,  7);
}

/**
 * @brief Get field signals from esea_stream message
 *
 * @return  What is sampled, by number: the values of the task's IN message, element by element, then those of its OUT message, both without the sequence.
 */
static inline uint16_t mavlink_msg_esea_stream_get_signals(const mavlink_message_t* msg, uint8_t *signals)
{
    return _MAV_RETURN_uint8_t_array(msg, signals, 59,  8);
}

/**
 * @brief Decode a esea_stream message into a struct
 *
 * @param msg The message to decode
 * @param esea_stream C-struct to decode the message contents into
 */
static inline void mavlink_msg_esea_stream_decode(const mavlink_message_t* msg, mavlink_esea_stream_t* esea_stream)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    esea_stream->interval = mavlink_msg_esea_stream_get_interval(msg);
    esea_stream->stream = mavlink_msg_esea_stream_get_stream(msg);
    esea_stream->task = mavlink_msg_esea_stream_get_task(msg);
    esea_stream->choice = mavlink_msg_esea_stream_get_choice(msg);
    esea_stream->count = mavlink_msg_esea_stream_get_count(msg);
    esea_stream->samples = mavlink_msg_esea_stream_get_samples(msg);
    esea_stream->result = mavlink_msg_esea_stream_get_result(msg);
    mavlink_msg_esea_stream_get_signals(msg, esea_stream->signals);
#else
        uint8_t len = msg->len < MAVLINK_MSG_ID_ESEA_STREAM_LEN? msg->len : MAVLINK_MSG_ID_ESEA_STREAM_LEN;
        memset(esea_stream, 0, MAVLINK_MSG_ID_ESEA_STREAM_LEN);
    memcpy(esea_stream, _MAV_PAYLOAD(msg), len);
#endif
}
