#pragma once
// MESSAGE ESEA_INFO PACKING

#include <stdint.h>

#define MAVLINK_MSG_ID_ESEA_INFO 42600


typedef struct __mavlink_esea_info_t {
 uint32_t tick_us; /*< [us] Base tick of the tasks.*/
 uint32_t fault; /*<  Latched fault.*/
 uint32_t steps; /*<  Steps since the last reset, all tasks.*/
 uint32_t sequence_gaps; /*<  Inputs since the last reset that did not follow their predecessor.*/
 uint32_t bad_frames; /*<  Frames since boot whose checksum was wrong.*/
 uint32_t unknown_messages; /*<  Frames since boot whose message the board does not take.*/
 uint32_t lost_bytes; /*< [bytes] Bytes since boot for which the receive buffer had no room.*/
 uint32_t receive_buffer_bytes; /*< [bytes] Size of the receive buffer: the host keeps fewer bytes on the way.*/
 uint32_t empty_ticks; /*<  Timer ticks of measuring a step that does nothing; to be taken off step_ticks.*/
 uint32_t stack_bytes; /*< [bytes] Size of the stack.*/
 uint32_t stack_peak_bytes; /*< [bytes] Most of the stack in use since boot.*/
 char content_hash[16]; /*<  Content hash of the C that runs here.*/
 char device[16]; /*<  Device name.*/
 char board[16]; /*<  Board name.*/
} mavlink_esea_info_t;

#define MAVLINK_MSG_ID_ESEA_INFO_LEN 92
#define MAVLINK_MSG_ID_ESEA_INFO_MIN_LEN 92
#define MAVLINK_MSG_ID_42600_LEN 92
#define MAVLINK_MSG_ID_42600_MIN_LEN 92

#define MAVLINK_MSG_ID_ESEA_INFO_CRC 248
#define MAVLINK_MSG_ID_42600_CRC 248

#define MAVLINK_MSG_ESEA_INFO_FIELD_CONTENT_HASH_LEN 16
#define MAVLINK_MSG_ESEA_INFO_FIELD_DEVICE_LEN 16
#define MAVLINK_MSG_ESEA_INFO_FIELD_BOARD_LEN 16

#if MAVLINK_COMMAND_24BIT
#define MAVLINK_MESSAGE_INFO_ESEA_INFO { \
    42600, \
    "ESEA_INFO", \
    14, \
    {  { "tick_us", NULL, MAVLINK_TYPE_UINT32_T, 0, 0, offsetof(mavlink_esea_info_t, tick_us) }, \
         { "fault", NULL, MAVLINK_TYPE_UINT32_T, 0, 4, offsetof(mavlink_esea_info_t, fault) }, \
         { "steps", NULL, MAVLINK_TYPE_UINT32_T, 0, 8, offsetof(mavlink_esea_info_t, steps) }, \
         { "sequence_gaps", NULL, MAVLINK_TYPE_UINT32_T, 0, 12, offsetof(mavlink_esea_info_t, sequence_gaps) }, \
         { "bad_frames", NULL, MAVLINK_TYPE_UINT32_T, 0, 16, offsetof(mavlink_esea_info_t, bad_frames) }, \
         { "unknown_messages", NULL, MAVLINK_TYPE_UINT32_T, 0, 20, offsetof(mavlink_esea_info_t, unknown_messages) }, \
         { "lost_bytes", NULL, MAVLINK_TYPE_UINT32_T, 0, 24, offsetof(mavlink_esea_info_t, lost_bytes) }, \
         { "receive_buffer_bytes", NULL, MAVLINK_TYPE_UINT32_T, 0, 28, offsetof(mavlink_esea_info_t, receive_buffer_bytes) }, \
         { "empty_ticks", NULL, MAVLINK_TYPE_UINT32_T, 0, 32, offsetof(mavlink_esea_info_t, empty_ticks) }, \
         { "stack_bytes", NULL, MAVLINK_TYPE_UINT32_T, 0, 36, offsetof(mavlink_esea_info_t, stack_bytes) }, \
         { "stack_peak_bytes", NULL, MAVLINK_TYPE_UINT32_T, 0, 40, offsetof(mavlink_esea_info_t, stack_peak_bytes) }, \
         { "content_hash", NULL, MAVLINK_TYPE_CHAR, 16, 44, offsetof(mavlink_esea_info_t, content_hash) }, \
         { "device", NULL, MAVLINK_TYPE_CHAR, 16, 60, offsetof(mavlink_esea_info_t, device) }, \
         { "board", NULL, MAVLINK_TYPE_CHAR, 16, 76, offsetof(mavlink_esea_info_t, board) }, \
         } \
}
#else
#define MAVLINK_MESSAGE_INFO_ESEA_INFO { \
    "ESEA_INFO", \
    14, \
    {  { "tick_us", NULL, MAVLINK_TYPE_UINT32_T, 0, 0, offsetof(mavlink_esea_info_t, tick_us) }, \
         { "fault", NULL, MAVLINK_TYPE_UINT32_T, 0, 4, offsetof(mavlink_esea_info_t, fault) }, \
         { "steps", NULL, MAVLINK_TYPE_UINT32_T, 0, 8, offsetof(mavlink_esea_info_t, steps) }, \
         { "sequence_gaps", NULL, MAVLINK_TYPE_UINT32_T, 0, 12, offsetof(mavlink_esea_info_t, sequence_gaps) }, \
         { "bad_frames", NULL, MAVLINK_TYPE_UINT32_T, 0, 16, offsetof(mavlink_esea_info_t, bad_frames) }, \
         { "unknown_messages", NULL, MAVLINK_TYPE_UINT32_T, 0, 20, offsetof(mavlink_esea_info_t, unknown_messages) }, \
         { "lost_bytes", NULL, MAVLINK_TYPE_UINT32_T, 0, 24, offsetof(mavlink_esea_info_t, lost_bytes) }, \
         { "receive_buffer_bytes", NULL, MAVLINK_TYPE_UINT32_T, 0, 28, offsetof(mavlink_esea_info_t, receive_buffer_bytes) }, \
         { "empty_ticks", NULL, MAVLINK_TYPE_UINT32_T, 0, 32, offsetof(mavlink_esea_info_t, empty_ticks) }, \
         { "stack_bytes", NULL, MAVLINK_TYPE_UINT32_T, 0, 36, offsetof(mavlink_esea_info_t, stack_bytes) }, \
         { "stack_peak_bytes", NULL, MAVLINK_TYPE_UINT32_T, 0, 40, offsetof(mavlink_esea_info_t, stack_peak_bytes) }, \
         { "content_hash", NULL, MAVLINK_TYPE_CHAR, 16, 44, offsetof(mavlink_esea_info_t, content_hash) }, \
         { "device", NULL, MAVLINK_TYPE_CHAR, 16, 60, offsetof(mavlink_esea_info_t, device) }, \
         { "board", NULL, MAVLINK_TYPE_CHAR, 16, 76, offsetof(mavlink_esea_info_t, board) }, \
         } \
}
#endif

/**
 * @brief Pack a esea_info message
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param msg The MAVLink message to compress the data into
 *
 * @param tick_us [us] Base tick of the tasks.
 * @param fault  Latched fault.
 * @param steps  Steps since the last reset, all tasks.
 * @param sequence_gaps  Inputs since the last reset that did not follow their predecessor.
 * @param bad_frames  Frames since boot whose checksum was wrong.
 * @param unknown_messages  Frames since boot whose message the board does not take.
 * @param lost_bytes [bytes] Bytes since boot for which the receive buffer had no room.
 * @param receive_buffer_bytes [bytes] Size of the receive buffer: the host keeps fewer bytes on the way.
 * @param empty_ticks  Timer ticks of measuring a step that does nothing; to be taken off step_ticks.
 * @param stack_bytes [bytes] Size of the stack.
 * @param stack_peak_bytes [bytes] Most of the stack in use since boot.
 * @param content_hash  Content hash of the C that runs here.
 * @param device  Device name.
 * @param board  Board name.
 * @return length of the message in bytes (excluding serial stream start sign)
 */
static inline uint16_t mavlink_msg_esea_info_pack(uint8_t system_id, uint8_t component_id, mavlink_message_t* msg,
                               uint32_t tick_us, uint32_t fault, uint32_t steps, uint32_t sequence_gaps, uint32_t bad_frames, uint32_t unknown_messages, uint32_t lost_bytes, uint32_t receive_buffer_bytes, uint32_t empty_ticks, uint32_t stack_bytes, uint32_t stack_peak_bytes, const char *content_hash, const char *device, const char *board)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    char buf[MAVLINK_MSG_ID_ESEA_INFO_LEN];
    _mav_put_uint32_t(buf, 0, tick_us);
    _mav_put_uint32_t(buf, 4, fault);
    _mav_put_uint32_t(buf, 8, steps);
    _mav_put_uint32_t(buf, 12, sequence_gaps);
    _mav_put_uint32_t(buf, 16, bad_frames);
    _mav_put_uint32_t(buf, 20, unknown_messages);
    _mav_put_uint32_t(buf, 24, lost_bytes);
    _mav_put_uint32_t(buf, 28, receive_buffer_bytes);
    _mav_put_uint32_t(buf, 32, empty_ticks);
    _mav_put_uint32_t(buf, 36, stack_bytes);
    _mav_put_uint32_t(buf, 40, stack_peak_bytes);
    _mav_put_char_array(buf, 44, content_hash, 16);
    _mav_put_char_array(buf, 60, device, 16);
    _mav_put_char_array(buf, 76, board, 16);
        memcpy(_MAV_PAYLOAD_NON_CONST(msg), buf, MAVLINK_MSG_ID_ESEA_INFO_LEN);
#else
    mavlink_esea_info_t packet;
    packet.tick_us = tick_us;
    packet.fault = fault;
    packet.steps = steps;
    packet.sequence_gaps = sequence_gaps;
    packet.bad_frames = bad_frames;
    packet.unknown_messages = unknown_messages;
    packet.lost_bytes = lost_bytes;
    packet.receive_buffer_bytes = receive_buffer_bytes;
    packet.empty_ticks = empty_ticks;
    packet.stack_bytes = stack_bytes;
    packet.stack_peak_bytes = stack_peak_bytes;
    mav_array_memcpy(packet.content_hash, content_hash, sizeof(char)*16);
    mav_array_memcpy(packet.device, device, sizeof(char)*16);
    mav_array_memcpy(packet.board, board, sizeof(char)*16);
        memcpy(_MAV_PAYLOAD_NON_CONST(msg), &packet, MAVLINK_MSG_ID_ESEA_INFO_LEN);
#endif

    msg->msgid = MAVLINK_MSG_ID_ESEA_INFO;
    return mavlink_finalize_message(msg, system_id, component_id, MAVLINK_MSG_ID_ESEA_INFO_MIN_LEN, MAVLINK_MSG_ID_ESEA_INFO_LEN, MAVLINK_MSG_ID_ESEA_INFO_CRC);
}

/**
 * @brief Pack a esea_info message
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param status MAVLink status structure
 * @param msg The MAVLink message to compress the data into
 *
 * @param tick_us [us] Base tick of the tasks.
 * @param fault  Latched fault.
 * @param steps  Steps since the last reset, all tasks.
 * @param sequence_gaps  Inputs since the last reset that did not follow their predecessor.
 * @param bad_frames  Frames since boot whose checksum was wrong.
 * @param unknown_messages  Frames since boot whose message the board does not take.
 * @param lost_bytes [bytes] Bytes since boot for which the receive buffer had no room.
 * @param receive_buffer_bytes [bytes] Size of the receive buffer: the host keeps fewer bytes on the way.
 * @param empty_ticks  Timer ticks of measuring a step that does nothing; to be taken off step_ticks.
 * @param stack_bytes [bytes] Size of the stack.
 * @param stack_peak_bytes [bytes] Most of the stack in use since boot.
 * @param content_hash  Content hash of the C that runs here.
 * @param device  Device name.
 * @param board  Board name.
 * @return length of the message in bytes (excluding serial stream start sign)
 */
static inline uint16_t mavlink_msg_esea_info_pack_status(uint8_t system_id, uint8_t component_id, mavlink_status_t *_status, mavlink_message_t* msg,
                               uint32_t tick_us, uint32_t fault, uint32_t steps, uint32_t sequence_gaps, uint32_t bad_frames, uint32_t unknown_messages, uint32_t lost_bytes, uint32_t receive_buffer_bytes, uint32_t empty_ticks, uint32_t stack_bytes, uint32_t stack_peak_bytes, const char *content_hash, const char *device, const char *board)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    char buf[MAVLINK_MSG_ID_ESEA_INFO_LEN];
    _mav_put_uint32_t(buf, 0, tick_us);
    _mav_put_uint32_t(buf, 4, fault);
    _mav_put_uint32_t(buf, 8, steps);
    _mav_put_uint32_t(buf, 12, sequence_gaps);
    _mav_put_uint32_t(buf, 16, bad_frames);
    _mav_put_uint32_t(buf, 20, unknown_messages);
    _mav_put_uint32_t(buf, 24, lost_bytes);
    _mav_put_uint32_t(buf, 28, receive_buffer_bytes);
    _mav_put_uint32_t(buf, 32, empty_ticks);
    _mav_put_uint32_t(buf, 36, stack_bytes);
    _mav_put_uint32_t(buf, 40, stack_peak_bytes);
    _mav_put_char_array(buf, 44, content_hash, 16);
    _mav_put_char_array(buf, 60, device, 16);
    _mav_put_char_array(buf, 76, board, 16);
        memcpy(_MAV_PAYLOAD_NON_CONST(msg), buf, MAVLINK_MSG_ID_ESEA_INFO_LEN);
#else
    mavlink_esea_info_t packet;
    packet.tick_us = tick_us;
    packet.fault = fault;
    packet.steps = steps;
    packet.sequence_gaps = sequence_gaps;
    packet.bad_frames = bad_frames;
    packet.unknown_messages = unknown_messages;
    packet.lost_bytes = lost_bytes;
    packet.receive_buffer_bytes = receive_buffer_bytes;
    packet.empty_ticks = empty_ticks;
    packet.stack_bytes = stack_bytes;
    packet.stack_peak_bytes = stack_peak_bytes;
    mav_array_memcpy(packet.content_hash, content_hash, sizeof(char)*16);
    mav_array_memcpy(packet.device, device, sizeof(char)*16);
    mav_array_memcpy(packet.board, board, sizeof(char)*16);
        memcpy(_MAV_PAYLOAD_NON_CONST(msg), &packet, MAVLINK_MSG_ID_ESEA_INFO_LEN);
#endif

    msg->msgid = MAVLINK_MSG_ID_ESEA_INFO;
#if MAVLINK_CRC_EXTRA
    return mavlink_finalize_message_buffer(msg, system_id, component_id, _status, MAVLINK_MSG_ID_ESEA_INFO_MIN_LEN, MAVLINK_MSG_ID_ESEA_INFO_LEN, MAVLINK_MSG_ID_ESEA_INFO_CRC);
#else
    return mavlink_finalize_message_buffer(msg, system_id, component_id, _status, MAVLINK_MSG_ID_ESEA_INFO_MIN_LEN, MAVLINK_MSG_ID_ESEA_INFO_LEN);
#endif
}

/**
 * @brief Pack a esea_info message on a channel
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param chan The MAVLink channel this message will be sent over
 * @param msg The MAVLink message to compress the data into
 * @param tick_us [us] Base tick of the tasks.
 * @param fault  Latched fault.
 * @param steps  Steps since the last reset, all tasks.
 * @param sequence_gaps  Inputs since the last reset that did not follow their predecessor.
 * @param bad_frames  Frames since boot whose checksum was wrong.
 * @param unknown_messages  Frames since boot whose message the board does not take.
 * @param lost_bytes [bytes] Bytes since boot for which the receive buffer had no room.
 * @param receive_buffer_bytes [bytes] Size of the receive buffer: the host keeps fewer bytes on the way.
 * @param empty_ticks  Timer ticks of measuring a step that does nothing; to be taken off step_ticks.
 * @param stack_bytes [bytes] Size of the stack.
 * @param stack_peak_bytes [bytes] Most of the stack in use since boot.
 * @param content_hash  Content hash of the C that runs here.
 * @param device  Device name.
 * @param board  Board name.
 * @return length of the message in bytes (excluding serial stream start sign)
 */
static inline uint16_t mavlink_msg_esea_info_pack_chan(uint8_t system_id, uint8_t component_id, uint8_t chan,
                               mavlink_message_t* msg,
                                   uint32_t tick_us,uint32_t fault,uint32_t steps,uint32_t sequence_gaps,uint32_t bad_frames,uint32_t unknown_messages,uint32_t lost_bytes,uint32_t receive_buffer_bytes,uint32_t empty_ticks,uint32_t stack_bytes,uint32_t stack_peak_bytes,const char *content_hash,const char *device,const char *board)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    char buf[MAVLINK_MSG_ID_ESEA_INFO_LEN];
    _mav_put_uint32_t(buf, 0, tick_us);
    _mav_put_uint32_t(buf, 4, fault);
    _mav_put_uint32_t(buf, 8, steps);
    _mav_put_uint32_t(buf, 12, sequence_gaps);
    _mav_put_uint32_t(buf, 16, bad_frames);
    _mav_put_uint32_t(buf, 20, unknown_messages);
    _mav_put_uint32_t(buf, 24, lost_bytes);
    _mav_put_uint32_t(buf, 28, receive_buffer_bytes);
    _mav_put_uint32_t(buf, 32, empty_ticks);
    _mav_put_uint32_t(buf, 36, stack_bytes);
    _mav_put_uint32_t(buf, 40, stack_peak_bytes);
    _mav_put_char_array(buf, 44, content_hash, 16);
    _mav_put_char_array(buf, 60, device, 16);
    _mav_put_char_array(buf, 76, board, 16);
        memcpy(_MAV_PAYLOAD_NON_CONST(msg), buf, MAVLINK_MSG_ID_ESEA_INFO_LEN);
#else
    mavlink_esea_info_t packet;
    packet.tick_us = tick_us;
    packet.fault = fault;
    packet.steps = steps;
    packet.sequence_gaps = sequence_gaps;
    packet.bad_frames = bad_frames;
    packet.unknown_messages = unknown_messages;
    packet.lost_bytes = lost_bytes;
    packet.receive_buffer_bytes = receive_buffer_bytes;
    packet.empty_ticks = empty_ticks;
    packet.stack_bytes = stack_bytes;
    packet.stack_peak_bytes = stack_peak_bytes;
    mav_array_memcpy(packet.content_hash, content_hash, sizeof(char)*16);
    mav_array_memcpy(packet.device, device, sizeof(char)*16);
    mav_array_memcpy(packet.board, board, sizeof(char)*16);
        memcpy(_MAV_PAYLOAD_NON_CONST(msg), &packet, MAVLINK_MSG_ID_ESEA_INFO_LEN);
#endif

    msg->msgid = MAVLINK_MSG_ID_ESEA_INFO;
    return mavlink_finalize_message_chan(msg, system_id, component_id, chan, MAVLINK_MSG_ID_ESEA_INFO_MIN_LEN, MAVLINK_MSG_ID_ESEA_INFO_LEN, MAVLINK_MSG_ID_ESEA_INFO_CRC);
}

/**
 * @brief Encode a esea_info struct
 *
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param msg The MAVLink message to compress the data into
 * @param esea_info C-struct to read the message contents from
 */
static inline uint16_t mavlink_msg_esea_info_encode(uint8_t system_id, uint8_t component_id, mavlink_message_t* msg, const mavlink_esea_info_t* esea_info)
{
    return mavlink_msg_esea_info_pack(system_id, component_id, msg, esea_info->tick_us, esea_info->fault, esea_info->steps, esea_info->sequence_gaps, esea_info->bad_frames, esea_info->unknown_messages, esea_info->lost_bytes, esea_info->receive_buffer_bytes, esea_info->empty_ticks, esea_info->stack_bytes, esea_info->stack_peak_bytes, esea_info->content_hash, esea_info->device, esea_info->board);
}

/**
 * @brief Encode a esea_info struct on a channel
 *
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param chan The MAVLink channel this message will be sent over
 * @param msg The MAVLink message to compress the data into
 * @param esea_info C-struct to read the message contents from
 */
static inline uint16_t mavlink_msg_esea_info_encode_chan(uint8_t system_id, uint8_t component_id, uint8_t chan, mavlink_message_t* msg, const mavlink_esea_info_t* esea_info)
{
    return mavlink_msg_esea_info_pack_chan(system_id, component_id, chan, msg, esea_info->tick_us, esea_info->fault, esea_info->steps, esea_info->sequence_gaps, esea_info->bad_frames, esea_info->unknown_messages, esea_info->lost_bytes, esea_info->receive_buffer_bytes, esea_info->empty_ticks, esea_info->stack_bytes, esea_info->stack_peak_bytes, esea_info->content_hash, esea_info->device, esea_info->board);
}

/**
 * @brief Encode a esea_info struct with provided status structure
 *
 * @param system_id ID of this system
 * @param component_id ID of this component (e.g. 200 for IMU)
 * @param status MAVLink status structure
 * @param msg The MAVLink message to compress the data into
 * @param esea_info C-struct to read the message contents from
 */
static inline uint16_t mavlink_msg_esea_info_encode_status(uint8_t system_id, uint8_t component_id, mavlink_status_t* _status, mavlink_message_t* msg, const mavlink_esea_info_t* esea_info)
{
    return mavlink_msg_esea_info_pack_status(system_id, component_id, _status, msg,  esea_info->tick_us, esea_info->fault, esea_info->steps, esea_info->sequence_gaps, esea_info->bad_frames, esea_info->unknown_messages, esea_info->lost_bytes, esea_info->receive_buffer_bytes, esea_info->empty_ticks, esea_info->stack_bytes, esea_info->stack_peak_bytes, esea_info->content_hash, esea_info->device, esea_info->board);
}

/**
 * @brief Send a esea_info message
 * @param chan MAVLink channel to send the message
 *
 * @param tick_us [us] Base tick of the tasks.
 * @param fault  Latched fault.
 * @param steps  Steps since the last reset, all tasks.
 * @param sequence_gaps  Inputs since the last reset that did not follow their predecessor.
 * @param bad_frames  Frames since boot whose checksum was wrong.
 * @param unknown_messages  Frames since boot whose message the board does not take.
 * @param lost_bytes [bytes] Bytes since boot for which the receive buffer had no room.
 * @param receive_buffer_bytes [bytes] Size of the receive buffer: the host keeps fewer bytes on the way.
 * @param empty_ticks  Timer ticks of measuring a step that does nothing; to be taken off step_ticks.
 * @param stack_bytes [bytes] Size of the stack.
 * @param stack_peak_bytes [bytes] Most of the stack in use since boot.
 * @param content_hash  Content hash of the C that runs here.
 * @param device  Device name.
 * @param board  Board name.
 */
#ifdef MAVLINK_USE_CONVENIENCE_FUNCTIONS

static inline void mavlink_msg_esea_info_send(mavlink_channel_t chan, uint32_t tick_us, uint32_t fault, uint32_t steps, uint32_t sequence_gaps, uint32_t bad_frames, uint32_t unknown_messages, uint32_t lost_bytes, uint32_t receive_buffer_bytes, uint32_t empty_ticks, uint32_t stack_bytes, uint32_t stack_peak_bytes, const char *content_hash, const char *device, const char *board)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    char buf[MAVLINK_MSG_ID_ESEA_INFO_LEN];
    _mav_put_uint32_t(buf, 0, tick_us);
    _mav_put_uint32_t(buf, 4, fault);
    _mav_put_uint32_t(buf, 8, steps);
    _mav_put_uint32_t(buf, 12, sequence_gaps);
    _mav_put_uint32_t(buf, 16, bad_frames);
    _mav_put_uint32_t(buf, 20, unknown_messages);
    _mav_put_uint32_t(buf, 24, lost_bytes);
    _mav_put_uint32_t(buf, 28, receive_buffer_bytes);
    _mav_put_uint32_t(buf, 32, empty_ticks);
    _mav_put_uint32_t(buf, 36, stack_bytes);
    _mav_put_uint32_t(buf, 40, stack_peak_bytes);
    _mav_put_char_array(buf, 44, content_hash, 16);
    _mav_put_char_array(buf, 60, device, 16);
    _mav_put_char_array(buf, 76, board, 16);
    _mav_finalize_message_chan_send(chan, MAVLINK_MSG_ID_ESEA_INFO, buf, MAVLINK_MSG_ID_ESEA_INFO_MIN_LEN, MAVLINK_MSG_ID_ESEA_INFO_LEN, MAVLINK_MSG_ID_ESEA_INFO_CRC);
#else
    mavlink_esea_info_t packet;
    packet.tick_us = tick_us;
    packet.fault = fault;
    packet.steps = steps;
    packet.sequence_gaps = sequence_gaps;
    packet.bad_frames = bad_frames;
    packet.unknown_messages = unknown_messages;
    packet.lost_bytes = lost_bytes;
    packet.receive_buffer_bytes = receive_buffer_bytes;
    packet.empty_ticks = empty_ticks;
    packet.stack_bytes = stack_bytes;
    packet.stack_peak_bytes = stack_peak_bytes;
    mav_array_memcpy(packet.content_hash, content_hash, sizeof(char)*16);
    mav_array_memcpy(packet.device, device, sizeof(char)*16);
    mav_array_memcpy(packet.board, board, sizeof(char)*16);
    _mav_finalize_message_chan_send(chan, MAVLINK_MSG_ID_ESEA_INFO, (const char *)&packet, MAVLINK_MSG_ID_ESEA_INFO_MIN_LEN, MAVLINK_MSG_ID_ESEA_INFO_LEN, MAVLINK_MSG_ID_ESEA_INFO_CRC);
#endif
}

/**
 * @brief Send a esea_info message
 * @param chan MAVLink channel to send the message
 * @param struct The MAVLink struct to serialize
 */
static inline void mavlink_msg_esea_info_send_struct(mavlink_channel_t chan, const mavlink_esea_info_t* esea_info)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    mavlink_msg_esea_info_send(chan, esea_info->tick_us, esea_info->fault, esea_info->steps, esea_info->sequence_gaps, esea_info->bad_frames, esea_info->unknown_messages, esea_info->lost_bytes, esea_info->receive_buffer_bytes, esea_info->empty_ticks, esea_info->stack_bytes, esea_info->stack_peak_bytes, esea_info->content_hash, esea_info->device, esea_info->board);
#else
    _mav_finalize_message_chan_send(chan, MAVLINK_MSG_ID_ESEA_INFO, (const char *)esea_info, MAVLINK_MSG_ID_ESEA_INFO_MIN_LEN, MAVLINK_MSG_ID_ESEA_INFO_LEN, MAVLINK_MSG_ID_ESEA_INFO_CRC);
#endif
}

#if MAVLINK_MSG_ID_ESEA_INFO_LEN <= MAVLINK_MAX_PAYLOAD_LEN
/*
  This variant of _send() can be used to save stack space by reusing
  memory from the receive buffer.  The caller provides a
  mavlink_message_t which is the size of a full mavlink message. This
  is usually the receive buffer for the channel, and allows a reply to an
  incoming message with minimum stack space usage.
 */
static inline void mavlink_msg_esea_info_send_buf(mavlink_message_t *msgbuf, mavlink_channel_t chan,  uint32_t tick_us, uint32_t fault, uint32_t steps, uint32_t sequence_gaps, uint32_t bad_frames, uint32_t unknown_messages, uint32_t lost_bytes, uint32_t receive_buffer_bytes, uint32_t empty_ticks, uint32_t stack_bytes, uint32_t stack_peak_bytes, const char *content_hash, const char *device, const char *board)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    char *buf = (char *)msgbuf;
    _mav_put_uint32_t(buf, 0, tick_us);
    _mav_put_uint32_t(buf, 4, fault);
    _mav_put_uint32_t(buf, 8, steps);
    _mav_put_uint32_t(buf, 12, sequence_gaps);
    _mav_put_uint32_t(buf, 16, bad_frames);
    _mav_put_uint32_t(buf, 20, unknown_messages);
    _mav_put_uint32_t(buf, 24, lost_bytes);
    _mav_put_uint32_t(buf, 28, receive_buffer_bytes);
    _mav_put_uint32_t(buf, 32, empty_ticks);
    _mav_put_uint32_t(buf, 36, stack_bytes);
    _mav_put_uint32_t(buf, 40, stack_peak_bytes);
    _mav_put_char_array(buf, 44, content_hash, 16);
    _mav_put_char_array(buf, 60, device, 16);
    _mav_put_char_array(buf, 76, board, 16);
    _mav_finalize_message_chan_send(chan, MAVLINK_MSG_ID_ESEA_INFO, buf, MAVLINK_MSG_ID_ESEA_INFO_MIN_LEN, MAVLINK_MSG_ID_ESEA_INFO_LEN, MAVLINK_MSG_ID_ESEA_INFO_CRC);
#else
    mavlink_esea_info_t *packet = (mavlink_esea_info_t *)msgbuf;
    packet->tick_us = tick_us;
    packet->fault = fault;
    packet->steps = steps;
    packet->sequence_gaps = sequence_gaps;
    packet->bad_frames = bad_frames;
    packet->unknown_messages = unknown_messages;
    packet->lost_bytes = lost_bytes;
    packet->receive_buffer_bytes = receive_buffer_bytes;
    packet->empty_ticks = empty_ticks;
    packet->stack_bytes = stack_bytes;
    packet->stack_peak_bytes = stack_peak_bytes;
    mav_array_memcpy(packet->content_hash, content_hash, sizeof(char)*16);
    mav_array_memcpy(packet->device, device, sizeof(char)*16);
    mav_array_memcpy(packet->board, board, sizeof(char)*16);
    _mav_finalize_message_chan_send(chan, MAVLINK_MSG_ID_ESEA_INFO, (const char *)packet, MAVLINK_MSG_ID_ESEA_INFO_MIN_LEN, MAVLINK_MSG_ID_ESEA_INFO_LEN, MAVLINK_MSG_ID_ESEA_INFO_CRC);
#endif
}
#endif

#endif

// MESSAGE ESEA_INFO UNPACKING


/**
 * @brief Get field tick_us from esea_info message
 *
 * @return [us] Base tick of the tasks.
 */
static inline uint32_t mavlink_msg_esea_info_get_tick_us(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  0);
}

/**
 * @brief Get field fault from esea_info message
 *
 * @return  Latched fault.
 */
static inline uint32_t mavlink_msg_esea_info_get_fault(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  4);
}

/**
 * @brief Get field steps from esea_info message
 *
 * @return  Steps since the last reset, all tasks.
 */
static inline uint32_t mavlink_msg_esea_info_get_steps(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  8);
}

/**
 * @brief Get field sequence_gaps from esea_info message
 *
 * @return  Inputs since the last reset that did not follow their predecessor.
 */
static inline uint32_t mavlink_msg_esea_info_get_sequence_gaps(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  12);
}

/**
 * @brief Get field bad_frames from esea_info message
 *
 * @return  Frames since boot whose checksum was wrong.
 */
static inline uint32_t mavlink_msg_esea_info_get_bad_frames(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  16);
}

/**
 * @brief Get field unknown_messages from esea_info message
 *
 * @return  Frames since boot whose message the board does not take.
 */
static inline uint32_t mavlink_msg_esea_info_get_unknown_messages(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  20);
}

/**
 * @brief Get field lost_bytes from esea_info message
 *
 * @return [bytes] Bytes since boot for which the receive buffer had no room.
 */
static inline uint32_t mavlink_msg_esea_info_get_lost_bytes(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  24);
}

/**
 * @brief Get field receive_buffer_bytes from esea_info message
 *
 * @return [bytes] Size of the receive buffer: the host keeps fewer bytes on the way.
 */
static inline uint32_t mavlink_msg_esea_info_get_receive_buffer_bytes(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  28);
}

/**
 * @brief Get field empty_ticks from esea_info message
 *
 * @return  Timer ticks of measuring a step that does nothing; to be taken off step_ticks.
 */
static inline uint32_t mavlink_msg_esea_info_get_empty_ticks(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  32);
}

/**
 * @brief Get field stack_bytes from esea_info message
 *
 * @return [bytes] Size of the stack.
 */
static inline uint32_t mavlink_msg_esea_info_get_stack_bytes(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  36);
}

/**
 * @brief Get field stack_peak_bytes from esea_info message
 *
 * @return [bytes] Most of the stack in use since boot.
 */
static inline uint32_t mavlink_msg_esea_info_get_stack_peak_bytes(const mavlink_message_t* msg)
{
    return _MAV_RETURN_uint32_t(msg,  40);
}

/**
 * @brief Get field content_hash from esea_info message
 *
 * @return  Content hash of the C that runs here.
 */
static inline uint16_t mavlink_msg_esea_info_get_content_hash(const mavlink_message_t* msg, char *content_hash)
{
    return _MAV_RETURN_char_array(msg, content_hash, 16,  44);
}

/**
 * @brief Get field device from esea_info message
 *
 * @return  Device name.
 */
static inline uint16_t mavlink_msg_esea_info_get_device(const mavlink_message_t* msg, char *device)
{
    return _MAV_RETURN_char_array(msg, device, 16,  60);
}

/**
 * @brief Get field board from esea_info message
 *
 * @return  Board name.
 */
static inline uint16_t mavlink_msg_esea_info_get_board(const mavlink_message_t* msg, char *board)
{
    return _MAV_RETURN_char_array(msg, board, 16,  76);
}

/**
 * @brief Decode a esea_info message into a struct
 *
 * @param msg The message to decode
 * @param esea_info C-struct to decode the message contents into
 */
static inline void mavlink_msg_esea_info_decode(const mavlink_message_t* msg, mavlink_esea_info_t* esea_info)
{
#if MAVLINK_NEED_BYTE_SWAP || !MAVLINK_ALIGNED_FIELDS
    esea_info->tick_us = mavlink_msg_esea_info_get_tick_us(msg);
    esea_info->fault = mavlink_msg_esea_info_get_fault(msg);
    esea_info->steps = mavlink_msg_esea_info_get_steps(msg);
    esea_info->sequence_gaps = mavlink_msg_esea_info_get_sequence_gaps(msg);
    esea_info->bad_frames = mavlink_msg_esea_info_get_bad_frames(msg);
    esea_info->unknown_messages = mavlink_msg_esea_info_get_unknown_messages(msg);
    esea_info->lost_bytes = mavlink_msg_esea_info_get_lost_bytes(msg);
    esea_info->receive_buffer_bytes = mavlink_msg_esea_info_get_receive_buffer_bytes(msg);
    esea_info->empty_ticks = mavlink_msg_esea_info_get_empty_ticks(msg);
    esea_info->stack_bytes = mavlink_msg_esea_info_get_stack_bytes(msg);
    esea_info->stack_peak_bytes = mavlink_msg_esea_info_get_stack_peak_bytes(msg);
    mavlink_msg_esea_info_get_content_hash(msg, esea_info->content_hash);
    mavlink_msg_esea_info_get_device(msg, esea_info->device);
    mavlink_msg_esea_info_get_board(msg, esea_info->board);
#else
        uint8_t len = msg->len < MAVLINK_MSG_ID_ESEA_INFO_LEN? msg->len : MAVLINK_MSG_ID_ESEA_INFO_LEN;
        memset(esea_info, 0, MAVLINK_MSG_ID_ESEA_INFO_LEN);
    memcpy(esea_info, _MAV_PAYLOAD(msg), len);
#endif
}
