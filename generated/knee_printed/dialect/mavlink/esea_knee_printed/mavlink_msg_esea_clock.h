#pragma once
// MESSAGE ESEA_CLOCK PACKING

#include <stdint.h>

#define MAVLINK_MSG_ID_ESEA_CLOCK 42661


typedef struct __mavlink_esea_clock_t {
 uint32_t tick; /*<  The next base tick.*/
 uint32_t lost_ticks; /*<  Base ticks since boot that came too late or not.*/
 uint32_t missed_runs; /*<  Runs since boot that did not start: the one before had not ended.*/
 uint32_t late_runs; /*<  Runs that had not ended at their release.*/
 uint32_t dropped; /*<  Runs since boot that found no room until they are sent.*/
 uint32_t refused; /*<  Commands and inputs since boot that the state refused.*/
 uint32_t deadline_left; /*<  Base ticks until the command's deadline; 0: none.*/
 uint32_t state; /*<  State of the board.*/
} mavlink_esea_clock_t;

#define MAVLINK_MSG_ID_ESEA_CLOCK_LEN 32
#define MAVLINK_MSG_ID_ESEA_CLOCK_MIN_LEN 32
#define MAVLINK_MSG_ID_42661_LEN 32
#define MAVLINK_MSG_ID_42661_MIN_LEN 32

#define MAVLINK_MSG_ID_ESEA_CLOCK_CRC 167
#define MAVLINK_MSG_ID_42661_CRC 167



#if MAVLINK_COMMAND_24BIT
#define MAVLINK_MESSAGE_INFO_ESEA_CLOCK { \
    42661, \
    "ESEA_CLOCK", \
    8, \
    {  { "tick", NULL, MAVLINK_TYPE_UINT32_T, 0, 0, offsetof(mavlink_esea_clock_t, tick) }, \
         { "lost_ticks", NULL, MAVLINK_TYPE_UINT32_T, 0, 4, offsetof(mavlink_esea_clock_t, lost_ticks) }, \
         { "missed_runs", NULL, MAVLINK_TYPE_UINT32_T, 0, 8, offsetof(mavlink_esea_clock_t, missed_runs) }, \
         { "late_runs", NULL, MAVLINK_TYPE_UINT32_T, 0, 12, offsetof(mavlink_esea_clock_t, late_runs) }, \
         { "dropped", NULL, MAVLINK_TYPE_UINT32_T, 0, 16, offsetof(mavlink_esea_clock_t, dropped) }, \
         { "refused", NULL, MAVLINK_TYPE_UINT32_T, 0, 20, offsetof(mavlink_esea_clock_t, refused) }, \
         { "deadline_left", NULL, MAVLINK_TYPE_UINT32_T, 0, 24, offsetof(mavlink_esea_clock_t, deadline_left) }, \
         { "state", NULL, MAVLINK_TYPE_UINT32_T, 0, 28, offsetof(mavlink_esea_clock_t, state) }, \
         } \
}
#else
#define MAVLINK_MESSAGE_INFO_ESEA_CLOCK { \
    "ESEA_CLOCK", \
    8, \
    {  { "tick", NULL, MAVLINK_TYPE_UINT32_T, 0, 0, offsetof(mavlink_esea_clock_t, tick) }, \
         { "lost_ticks", NULL, MAVLINK_TYPE_UINT32_T, 0, 4, offsetof(mavlink_esea_clock_t, lost_ticks) }, \
         { "missed_runs", NULL, MAVLINK_TYPE_UINT32_T, 0, 8, offsetof(mavlink_esea_clock_t, missed_runs) }, \
         { "late_runs", NULL, MAVLINK_TYPE_UINT32_T, 0, 12, offsetof(mavlink_esea_clock_t, late_runs) }, \
         { "dropped", NULL, MAVLINK_TYPE_UINT32_T, 0, 16, offsetof(mavlink_esea_clock_t, dropped) }, \
         { "refused", NULL, MAVLINK_TYPE_UINT32_T, 0, 20, offsetof(mavlink_esea_clock_t, refused) }, \
         { "deadline_left", NULL, MAVLINK_TYPE_UINT32_T, 0, 24, offsetof(mavlink_esea_clock_t, deadline_left) }, \
         { "state", NULL, MAVLINK_TYPE_UINT32_T, 0, 28, offsetof(mavlink_esea_clock_t, state) }, \
         } \
}
#endif

/**
 * @brief Pack a esea_clock message
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param msg The MAVLink message to compress the data into
 *
 * @param tick  The next base tick.
 * @param lost_ticks  Base ticks since boot that came too late or not.
 * @param missed_runs  Runs since boot that did not start: the one before had not ended.
 * @param late_runs  Runs that had not ended at their release.
 * @param dropped  Runs since boot that found no room until they are sent.
 * @param refused  Commands and inputs since boot that the state refused.
 * @param deadline_left  Base ticks until the command's deadline; 0: none.
 * @param state  State of the board.
 * @return length of the message in bytes (excluding serial stream start sign)
 */
static inline uint16_t mavlink_msg_esea_clock_pack(uint8_t system_id, uint8_t component_id, mavlink_message_t* msg,
                               uint32_t tick, uint32_t lost_ticks, uint32_t missed_runs, uint32_t late_runs, uint32_t dropped, uint32_t refused, uint32_t deadline_left, uint32_t state)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    char buf[MAVLINK_MSG_ID_ESEA_CLOCK_LEN];
    _mav_put_uint32_t(buf, 0, tick);
    _mav_put_uint32_t(buf, 4, lost_ticks);
    _mav_put_uint32_t(buf, 8, missed_runs);
    _mav_put_uint32_t(buf, 12, late_runs);
    _mav_put_uint32_t(buf, 16, dropped);
    _mav_put_uint32_t(buf, 20, refused);
    _mav_put_uint32_t(buf, 24, deadline_left);
    _mav_put_uint32_t(buf, 28, state);

        memcpy(_MAV_PAYLOAD_NON_CONST(msg), buf, MAVLINK_MSG_ID_ESEA_CLOCK_LEN);
#else
    mavlink_esea_clock_t packet;
    packet.tick = tick;
    packet.lost_ticks = lost_ticks;
    packet.missed_runs = missed_runs;
    packet.late_runs = late_runs;
    packet.dropped = dropped;
    packet.refused = refused;
    packet.deadline_left = deadline_left;
    packet.state = state;

        memcpy(_MAV_PAYLOAD_NON_CONST(msg), &packet, MAVLINK_MSG_ID_ESEA_CLOCK_LEN);
#endif

    msg->msgid = MAVLINK_MSG_ID_ESEA_CLOCK;
    return mavlink_finalize_message(msg, system_id, component_id, MAVLINK_MSG_ID_ESEA_CLOCK_MIN_LEN, MAVLINK_MSG_ID_ESEA_CLOCK_LEN, MAVLINK_MSG_ID_ESEA_CLOCK_CRC);
}

/**
 * @brief Pack a esea_clock message
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param status MAVLink status structure
 * @param msg The MAVLink message to compress the data into
 *
 * @param tick  The next base tick.
 * @param lost_ticks  Base ticks since boot that came too late or not.
 * @param missed_runs  Runs since boot that did not start: the one before had not ended.
 * @param late_runs  Runs that had not ended at their release.
 * @param dropped  Runs since boot that found no room until they are sent.
 * @param refused  Commands and inputs since boot that the state refused.
 * @param deadline_left  Base ticks until the command's deadline; 0: none.
 * @param state  State of the board.
 * @return length of the message in bytes (excluding serial stream start sign)
 */
static inline uint16_t mavlink_msg_esea_clock_pack_status(uint8_t system_id, uint8_t component_id, mavlink_status_t *_status, mavlink_message_t* msg,
                               uint32_t tick, uint32_t lost_ticks, uint32_t missed_runs, uint32_t late_runs, uint32_t dropped, uint32_t refused, uint32_t deadline_left, uint32_t state)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    char buf[MAVLINK_MSG_ID_ESEA_CLOCK_LEN];
    _mav_put_uint32_t(buf, 0, tick);
    _mav_put_uint32_t(buf, 4, lost_ticks);
    _mav_put_uint32_t(buf, 8, missed_runs);
    _mav_put_uint32_t(buf, 12, late_runs);
    _mav_put_uint32_t(buf, 16, dropped);
    _mav_put_uint32_t(buf, 20, refused);
    _mav_put_uint32_t(buf, 24, deadline_left);
    _mav_put_uint32_t(buf, 28, state);

        memcpy(_MAV_PAYLOAD_NON_CONST(msg), buf, MAVLINK_MSG_ID_ESEA_CLOCK_LEN);
#else
    mavlink_esea_clock_t packet;
    packet.tick = tick;
    packet.lost_ticks = lost_ticks;
    packet.missed_runs = missed_runs;
    packet.late_runs = late_runs;
    packet.dropped = dropped;
    packet.refused = refused;
    packet.deadline_left = deadline_left;
    packet.state = state;

        memcpy(_MAV_PAYLOAD_NON_CONST(msg), &packet, MAVLINK_MSG_ID_ESEA_CLOCK_LEN);
#endif

    msg->msgid = MAVLINK_MSG_ID_ESEA_CLOCK;
#if MAVLINK_CRC_EXTRA
    return mavlink_finalize_message_buffer(msg, system_id, component_id, _status, MAVLINK_MSG_ID_ESEA_CLOCK_MIN_LEN, MAVLINK_MSG_ID_ESEA_CLOCK_LEN, MAVLINK_MSG_ID_ESEA_CLOCK_CRC);
#else
    return mavlink_finalize_message_buffer(msg, system_id, component_id, _status, MAVLINK_MSG_ID_ESEA_CLOCK_MIN_LEN, MAVLINK_MSG_ID_ESEA_CLOCK_LEN);
#endif
}

/**
 * @brief Pack a esea_clock message on a channel
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param chan The MAVLink channel this message will be sent over
 * @param msg The MAVLink message to compress the data into
 * @param tick  The next base tick.
 * @param lost_ticks  Base ticks since boot that came too late or not.
 * @param missed_runs  Runs since boot that did not start: the one before had not ended.
 * @param late_runs  Runs that had not ended at their release.
 * @param dropped  Runs since boot that found no room until they are sent.
 * @param refused  Commands and inputs since boot that the state refused.
 * @param deadline_left  Base ticks until the command's deadline; 0: none.
 * @param state  State of the board.
 * @return length of the message in bytes (excluding serial stream start sign)
 */
static inline uint16_t mavlink_msg_esea_clock_pack_chan(uint8_t system_id, uint8_t component_id, uint8_t chan,
                               mavlink_message_t* msg,
                                   uint32_t tick,uint32_t lost_ticks,uint32_t missed_runs,uint32_t late_runs,uint32_t dropped,uint32_t refused,uint32_t deadline_left,uint32_t state)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    char buf[MAVLINK_MSG_ID_ESEA_CLOCK_LEN];
    _mav_put_uint32_t(buf, 0, tick);
    _mav_put_uint32_t(buf, 4, lost_ticks);
    _mav_put_uint32_t(buf, 8, missed_runs);
    _mav_put_uint32_t(buf, 12, late_runs);
    _mav_put_uint32_t(buf, 16, dropped);
    _mav_put_uint32_t(buf, 20, refused);
    _mav_put_uint32_t(buf, 24, deadline_left);
    _mav_put_uint32_t(buf, 28, state);

        memcpy(_MAV_PAYLOAD_NON_CONST(msg), buf, MAVLINK_MSG_ID_ESEA_CLOCK_LEN);
#else
    mavlink_esea_clock_t packet;
    packet.tick = tick;
    packet.lost_ticks = lost_ticks;
    packet.missed_runs = missed_runs;
    packet.late_runs = late_runs;
    packet.dropped = dropped;
    packet.refused = refused;
    packet.deadline_left = deadline_left;
    packet.state = state;

        memcpy(_MAV_PAYLOAD_NON_CONST(msg), &packet, MAVLINK_MSG_ID_ESEA_CLOCK_LEN);
#endif

    msg->msgid = MAVLINK_MSG_ID_ESEA_CLOCK;
    return mavlink_finalize_message_chan(msg, system_id, component_id, chan, MAVLINK_MSG_ID_ESEA_CLOCK_MIN_LEN, MAVLINK_MSG_ID_ESEA_CLOCK_LEN, MAVLINK_MSG_ID_ESEA_CLOCK_CRC);
}

/**
 * @brief Encode a esea_clock struct
 *
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param msg The MAVLink message to compress the data into
 * @param esea_clock C-struct to read the message contents from
 */
static inline uint16_t mavlink_msg_esea_clock_encode(uint8_t system_id, uint8_t component_id, mavlink_message_t* msg, const mavlink_esea_clock_t* esea_clock)
{
    return mavlink_msg_esea_clock_pack(system_id, component_id, msg, esea_clock->tick, esea_clock->lost_ticks, esea_clock->missed_runs, esea_clock->late_runs, esea_clock->dropped, esea_clock->refused, esea_clock->deadline_left, esea_clock->state);
}

/**
 * @brief Encode a esea_clock struct on a channel
 *
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param chan The MAVLink channel this message will be sent over
 * @param msg The MAVLink message to compress the data into
 * @param esea_clock C-struct to read the message contents from
 */
static inline uint16_t mavlink_msg_esea_clock_encode_chan(uint8_t system_id, uint8_t component_id, uint8_t chan, mavlink_message_t* msg, const mavlink_esea_clock_t* esea_clock)
{
    return mavlink_msg_esea_clock_pack_chan(system_id, component_id, chan, msg, esea_clock->tick, esea_clock->lost_ticks, esea_clock->missed_runs, esea_clock->late_runs, esea_clock->dropped, esea_clock->refused, esea_clock->deadline_left, esea_clock->state);
}

/**
 * @brief Encode a esea_clock struct with provided status structure
 *
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param status MAVLink status structure
 * @param msg The MAVLink message to compress the data into
 * @param esea_clock C-struct to read the message contents from
 */
static inline uint16_t mavlink_msg_esea_clock_encode_status(uint8_t system_id, uint8_t component_id, mavlink_status_t* _status, mavlink_message_t* msg, const mavlink_esea_clock_t* esea_clock)
{
    return mavlink_msg_esea_clock_pack_status(system_id, component_id, _status, msg,  esea_clock->tick, esea_clock->lost_ticks, esea_clock->missed_runs, esea_clock->late_runs, esea_clock->dropped, esea_clock->refused, esea_clock->deadline_left, esea_clock->state);
}

/**
 * @brief Send a esea_clock message
 * @param chan MAVLink channel to send the message
 *
 * @param tick  The next base tick.
 * @param lost_ticks  Base ticks since boot that came too late or not.
 * @param missed_runs  Runs since boot that did not start: the one before had not ended.
 * @param late_runs  Runs that had not ended at their release.
 * @param dropped  Runs since boot that found no room until they are sent.
 * @param refused  Commands and inputs since boot that the state refused.
 * @param deadline_left  Base ticks until the command's deadline; 0: none.
 * @param state  State of the board.
 */
#ifdef MAVLINK_USE_CONVENIENCE_FUNCTIONS

static inline void mavlink_msg_esea_clock_send(mavlink_channel_t chan, uint32_t tick, uint32_t lost_ticks, uint32_t missed_runs, uint32_t late_runs, uint32_t dropped, uint32_t refused, uint32_t deadline_left, uint32_t state)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    char buf[MAVLINK_MSG_ID_ESEA_CLOCK_LEN];
    _mav_put_uint32_t(buf, 0, tick);
    _mav_put_uint32_t(buf, 4, lost_ticks);
    _mav_put_uint32_t(buf, 8, missed_runs);
    _mav_put_uint32_t(buf, 12, late_runs);
    _mav_put_uint32_t(buf, 16, dropped);
    _mav_put_uint32_t(buf, 20, refused);
    _mav_put_uint32_t(buf, 24, deadline_left);
    _mav_put_uint32_t(buf, 28, state);

    _mav_finalize_message_chan_send(chan, MAVLINK_MSG_ID_ESEA_CLOCK, buf, MAVLINK_MSG_ID_ESEA_CLOCK_MIN_LEN, MAVLINK_MSG_ID_ESEA_CLOCK_LEN, MAVLINK_MSG_ID_ESEA_CLOCK_CRC);
#else
    mavlink_esea_clock_t packet;
    packet.tick = tick;
    packet.lost_ticks = lost_ticks;
    packet.missed_runs = missed_runs;
    packet.late_runs = late_runs;
    packet.dropped = dropped;
    packet.refused = refused;
    packet.deadline_left = deadline_left;
    packet.state = state;

    _mav_finalize_message_chan_send(chan, MAVLINK_MSG_ID_ESEA_CLOCK, (const char *)&packet, MAVLINK_MSG_ID_ESEA_CLOCK_MIN_LEN, MAVLINK_MSG_ID_ESEA_CLOCK_LEN, MAVLINK_MSG_ID_ESEA_CLOCK_CRC);
#endif
}

/**
 * @brief Send a esea_clock message
 * @param chan MAVLink channel to send the message
 * @param struct The MAVLink struct to serialize
 */
static inline void mavlink_msg_esea_clock_send_struct(mavlink_channel_t chan, const mavlink_esea_clock_t* esea_clock)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    mavlink_msg_esea_clock_send(chan, esea_clock->tick, esea_clock->lost_ticks, esea_clock->missed_runs, esea_clock->late_runs, esea_clock->dropped, esea_clock->refused, esea_clock->deadline_left, esea_clock->state);
#else
    _mav_finalize_message_chan_send(chan, MAVLINK_MSG_ID_ESEA_CLOCK, (const char *)esea_clock, MAVLINK_MSG_ID_ESEA_CLOCK_MIN_LEN, MAVLINK_MSG_ID_ESEA_CLOCK_LEN, MAVLINK_MSG_ID_ESEA_CLOCK_CRC);
#endif
}

#if MAVLINK_MSG_ID_ESEA_CLOCK_LEN <= MAVLINK_MAX_PAYLOAD_LEN
/*
  This variant of _send() can be used to save stack space by reusing
  memory from the receive buffer.  The caller provides a
  mavlink_message_t which is the size of a full mavlink message. This
  is usually the receive buffer for the channel, and allows a reply to an
  incoming message with minimum stack space usage.
 */
static inline void mavlink_msg_esea_clock_send_buf(mavlink_message_t *msgbuf, mavlink_channel_t chan,  uint32_t tick, uint32_t lost_ticks, uint32_t missed_runs, uint32_t late_runs, uint32_t dropped, uint32_t refused, uint32_t deadline_left, uint32_t state)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    char *buf = (char *)msgbuf;
    _mav_put_uint32_t(buf, 0, tick);
    _mav_put_uint32_t(buf, 4, lost_ticks);
    _mav_put_uint32_t(buf, 8, missed_runs);
    _mav_put_uint32_t(buf, 12, late_runs);
    _mav_put_uint32_t(buf, 16, dropped);
    _mav_put_uint32_t(buf, 20, refused);
    _mav_put_uint32_t(buf, 24, deadline_left);
    _mav_put_uint32_t(buf, 28, state);

    _mav_finalize_message_chan_send(chan, MAVLINK_MSG_ID_ESEA_CLOCK, buf, MAVLINK_MSG_ID_ESEA_CLOCK_MIN_LEN, MAVLINK_MSG_ID_ESEA_CLOCK_LEN, MAVLINK_MSG_ID_ESEA_CLOCK_CRC);
#else
    mavlink_esea_clock_t *packet = (mavlink_esea_clock_t *)msgbuf;
    packet->tick = tick;
    packet->lost_ticks = lost_ticks;
    packet->missed_runs = missed_runs;
    packet->late_runs = late_runs;
    packet->dropped = dropped;
    packet->refused = refused;
    packet->deadline_left = deadline_left;
    packet->state = state;

    _mav_finalize_message_chan_send(chan, MAVLINK_MSG_ID_ESEA_CLOCK, (const char *)packet, MAVLINK_MSG_ID_ESEA_CLOCK_MIN_LEN, MAVLINK_MSG_ID_ESEA_CLOCK_LEN, MAVLINK_MSG_ID_ESEA_CLOCK_CRC);
#endif
}
#endif

#endif

// MESSAGE ESEA_CLOCK UNPACKING


/**
 * @brief Get field tick from esea_clock message
 *
 * @return  The next base tick.
 */
static inline uint32_t mavlink_msg_esea_clock_get_tick(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  0);
}

/**
 * @brief Get field lost_ticks from esea_clock message
 *
 * @return  Base ticks since boot that came too late or not.
 */
static inline uint32_t mavlink_msg_esea_clock_get_lost_ticks(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  4);
}

/**
 * @brief Get field missed_runs from esea_clock message
 *
 * @return  Runs since boot that did not start: the one before had not ended.
 */
static inline uint32_t mavlink_msg_esea_clock_get_missed_runs(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  8);
}

/**
 * @brief Get field late_runs from esea_clock message
 *
 * @return  Runs that had not ended at their release.
 */
static inline uint32_t mavlink_msg_esea_clock_get_late_runs(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  12);
}

/**
 * @brief Get field dropped from esea_clock message
 *
 * @return  Runs since boot that found no room until they are sent.
 */
static inline uint32_t mavlink_msg_esea_clock_get_dropped(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  16);
}

/**
 * @brief Get field refused from esea_clock message
 *
 * @return  Commands and inputs since boot that the state refused.
 */
static inline uint32_t mavlink_msg_esea_clock_get_refused(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  20);
}

/**
 * @brief Get field deadline_left from esea_clock message
 *
 * @return  Base ticks until the command's deadline; 0: none.
 */
static inline uint32_t mavlink_msg_esea_clock_get_deadline_left(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  24);
}

/**
 * @brief Get field state from esea_clock message
 *
 * @return  State of the board.
 */
static inline uint32_t mavlink_msg_esea_clock_get_state(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  28);
}

/**
 * @brief Decode a esea_clock message into a struct
 *
 * @param msg The message to decode
 * @param esea_clock C-struct to decode the message contents into
 */
static inline void mavlink_msg_esea_clock_decode(const mavlink_message_t* msg, mavlink_esea_clock_t* esea_clock)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    esea_clock->tick = mavlink_msg_esea_clock_get_tick(msg);
    esea_clock->lost_ticks = mavlink_msg_esea_clock_get_lost_ticks(msg);
    esea_clock->missed_runs = mavlink_msg_esea_clock_get_missed_runs(msg);
    esea_clock->late_runs = mavlink_msg_esea_clock_get_late_runs(msg);
    esea_clock->dropped = mavlink_msg_esea_clock_get_dropped(msg);
    esea_clock->refused = mavlink_msg_esea_clock_get_refused(msg);
    esea_clock->deadline_left = mavlink_msg_esea_clock_get_deadline_left(msg);
    esea_clock->state = mavlink_msg_esea_clock_get_state(msg);
#else
        uint8_t len = msg->len < MAVLINK_MSG_ID_ESEA_CLOCK_LEN? msg->len : MAVLINK_MSG_ID_ESEA_CLOCK_LEN;
        memset(esea_clock, 0, MAVLINK_MSG_ID_ESEA_CLOCK_LEN);
    memcpy(esea_clock, _MAV_PAYLOAD(msg), len);
#endif
}
