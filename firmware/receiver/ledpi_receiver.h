/* Receives ledpi's serial stream: bytes in, poses out. C99, no heap, no library, some 130 bytes of RAM.
 *
 *     static ledpi_receiver receiver;               // all zero is its start
 *     …
 *     switch (ledpi_feed(&receiver, byte)) {        // for each byte that arrives
 *     case LEDPI_FIX: use(&receiver.message.fix); break;
 *     default: break;
 *     }
 *
 * docs/wire.md is the contract, with frames, units and axes. Poses stay in the wire's whole numbers, as a small
 * processor wants them: lengths in 0.1 mm, angles in 0.1 mrad, quaternions in 1/32767.
 */
#ifndef LEDPI_RECEIVER_H
#define LEDPI_RECEIVER_H

#include <stdbool.h>
#include <stdint.h>

#define LEDPI_VERSION 1
#define LEDPI_MAX_CODED_BYTES 39                 /* of a frame, without its delimiter */
#define LEDPI_UNKNOWN_DEVIATION UINT32_MAX
#define LEDPI_UNKNOWN_TEMPERATURE INT8_MIN       /* all other unknown values are their type's largest */

/* What `ledpi_feed` has just completed. */
typedef enum { LEDPI_NOTHING = 0, LEDPI_MARKER = 1, LEDPI_FIX = 2, LEDPI_STATUS = 3 } ledpi_kind;

typedef enum { LEDPI_STARTING, LEDPI_RUNNING, LEDPI_CAMERA_LOST, LEDPI_STOPPING, LEDPI_STATE_UNKNOWN = 255 } ledpi_state;

/* Why there is no fix: every value but the first. */
typedef enum {
    LEDPI_HAS_FIX,
    LEDPI_NOT_RUNNING,
    LEDPI_NO_FRAMES,
    LEDPI_UNCALIBRATED,
    LEDPI_NO_MAP,
    LEDPI_NO_PANEL,
    LEDPI_NOT_IN_MAP,
    LEDPI_REJECTED,
    LEDPI_STALE,
    LEDPI_BEHIND, /* the camera delivers, and frames are decoded too late */
    LEDPI_NO_FIX_UNKNOWN = 255
} ledpi_no_fix;

/* Why a frame was thrown away: damaged up to `LEDPI_VALUE`, a newer sender's from there on. */
typedef enum { LEDPI_LENGTH, LEDPI_COBS, LEDPI_CRC, LEDPI_VALUE, LEDPI_OTHER_VERSION, LEDPI_OTHER_TYPE, LEDPI_OTHER_FLAGS, LEDPI_WHOLE } ledpi_fault;

typedef struct {
    int32_t position_100um[3];
    int16_t quaternion_q15[4];       /* w, x, y, z */
    uint32_t deviation_100um[3];     /* standard deviations along x, y, z, or LEDPI_UNKNOWN_DEVIATION */
    uint32_t deviation_100urad[3];   /* of the rotation about x, y, z */
} ledpi_pose;

typedef struct {
    uint32_t age_us; /* from mid-exposure to the first byte of this frame on the wire */
    uint16_t id;
    bool uncalibrated, ambiguous, alternate;
    bool has_pose;
    ledpi_pose pose; /* camera_from_marker */
} ledpi_marker;

typedef struct {
    uint32_t age_us;
    uint8_t panels_used;
    uint8_t map_resets; /* other maps since the start: after a change, forget older fixes */
    ledpi_pose pose;    /* map_from_base_link */
} ledpi_fix;

typedef struct {
    uint8_t state;  /* a ledpi_state */
    uint8_t no_fix; /* a ledpi_no_fix */
    uint8_t panels_in_view;
    int8_t temperature_c;
    uint16_t throttling;
    uint16_t decode_p50_us, decode_p99_us;
    uint32_t uptime_s, frames, frames_dropped, markers, packets_dropped;
} ledpi_status;

typedef struct {
    union {
        ledpi_marker marker;
        ledpi_fix fix;
        ledpi_status status;
    } message;         /* the one that `ledpi_feed` has just completed, until it is called again */
    uint16_t sequence; /* of the newest frame whose CRC was right */
    uint32_t good, lost, restarts;
    uint32_t faults[LEDPI_WHOLE]; /* by ledpi_fault */

    uint8_t frame[LEDPI_MAX_CODED_BYTES]; /* private from here on */
    uint8_t length;                       /* so far; one more than fits: too long */
    bool joined, has_sequence;
} ledpi_receiver;

static inline uint16_t ledpi_u16(const uint8_t *b) { return (uint16_t)(b[0] | (uint16_t)b[1] << 8); }

static inline uint32_t ledpi_u32(const uint8_t *b) { return ledpi_u16(b) | (uint32_t)ledpi_u16(b + 2) << 16; }

static inline int32_t ledpi_i24(const uint8_t *b)
{
    return (int32_t)((uint32_t)b[0] << 8 | (uint32_t)b[1] << 16 | (uint32_t)b[2] << 24) >> 8;
}

/* zlib's CRC-32, bit by bit: 34 bytes take an ATmega 0.4 ms, and a table would take a kilobyte. */
static inline uint32_t ledpi_crc32(const uint8_t *bytes, uint8_t count)
{
    uint32_t crc = 0xFFFFFFFFu;
    while (count--) {
        crc ^= *bytes++;
        for (uint8_t bit = 0; bit < 8; bit++)
            crc = crc & 1 ? crc >> 1 ^ 0xEDB88320u : crc >> 1;
    }
    return ~crc;
}

/* Undoes COBS in place. Returns how many bytes there are then; -1 where it is no COBS. */
static inline int8_t ledpi_uncobs(uint8_t *bytes, uint8_t count)
{
    uint8_t from = 0;
    int8_t to = 0;
    while (from < count) {
        const uint8_t block = bytes[from++];
        if (block - 1 > count - from)
            return -1;
        for (uint8_t i = 1; i < block; i++)
            bytes[to++] = bytes[from++];
        if (from < count)
            bytes[to++] = 0;
    }
    return to;
}

/* A logarithmic byte: high half e, low half m. 254 is 49.152 m or rad, or more; 255 is unknown. */
static inline uint32_t ledpi_deviation(uint8_t code)
{
    const uint8_t e = code >> 4, m = code & 15;
    if (code == 255)
        return LEDPI_UNKNOWN_DEVIATION;
    return e ? (uint32_t)(16 + m) << (e - 1) : m;
}

static inline void ledpi_deviations(const uint8_t *codes, uint32_t *deviations)
{
    const bool unknown = codes[0] == 255 || codes[1] == 255 || codes[2] == 255;
    for (uint8_t i = 0; i < 3; i++)
        deviations[i] = unknown ? LEDPI_UNKNOWN_DEVIATION : ledpi_deviation(codes[i]);
}

/* The pose at offset 11 of either pose message. */
static inline ledpi_fault ledpi_read_pose(const uint8_t *b, ledpi_pose *pose, bool *has_pose)
{
    uint32_t norm2 = 0; /* 4 · 32767² fits */
    *has_pose = true;
    for (uint8_t i = 0; i < 3; i++) {
        pose->position_100um[i] = ledpi_i24(b + 3 * i);
        if (pose->position_100um[i] == -0x800000L)
            *has_pose = false;
    }
    for (uint8_t i = 0; i < 4; i++) {
        const int16_t q = pose->quaternion_q15[i] = (int16_t)ledpi_u16(b + 9 + 2 * i);
        if (q == INT16_MIN)
            *has_pose = false;
        norm2 += (uint32_t)((int32_t)q * q);
    }
    ledpi_deviations(b + 17, pose->deviation_100um);
    ledpi_deviations(b + 20, pose->deviation_100urad);
    /* a length within 0.1 % of 1: (0.999 · 32767)² and (1.001 · 32767)² */
    return *has_pose && (norm2 < 1071530011u || norm2 > 1075824715u) ? LEDPI_VALUE : LEDPI_WHOLE;
}

static inline ledpi_fault ledpi_read_marker(const uint8_t *b, ledpi_marker *marker)
{
    const uint8_t flags = b[6];
    if (flags & ~7u)
        return LEDPI_OTHER_FLAGS;
    marker->id = ledpi_u16(b + 4);
    marker->uncalibrated = flags & 1;
    marker->ambiguous = flags & 2;
    marker->alternate = flags & 4;
    marker->age_us = ledpi_u32(b + 7);
    const ledpi_fault fault = ledpi_read_pose(b + 11, &marker->pose, &marker->has_pose);
    if ((marker->uncalibrated && marker->has_pose) || (marker->alternate && !marker->ambiguous))
        return LEDPI_VALUE;
    return fault;
}

static inline ledpi_fault ledpi_read_fix(const uint8_t *b, ledpi_fix *fix)
{
    bool has_pose;
    if (b[6])
        return LEDPI_OTHER_FLAGS;
    fix->panels_used = b[4];
    fix->map_resets = b[5];
    fix->age_us = ledpi_u32(b + 7);
    const ledpi_fault fault = ledpi_read_pose(b + 11, &fix->pose, &has_pose);
    return has_pose ? fault : LEDPI_VALUE;
}

static inline void ledpi_read_status(const uint8_t *b, ledpi_status *status)
{
    status->state = b[4] > LEDPI_STOPPING ? (uint8_t)LEDPI_STATE_UNKNOWN : b[4];
    status->no_fix = b[5] > LEDPI_BEHIND ? (uint8_t)LEDPI_NO_FIX_UNKNOWN : b[5];
    status->panels_in_view = b[6];
    status->temperature_c = (int8_t)b[7];
    status->throttling = ledpi_u16(b + 8);
    if (status->throttling != UINT16_MAX)
        status->throttling &= 0x0F0F; /* the bits that mean something */
    status->uptime_s = ledpi_u32(b + 10);
    status->frames = ledpi_u32(b + 14);
    status->frames_dropped = ledpi_u32(b + 18);
    status->markers = ledpi_u32(b + 22);
    status->packets_dropped = ledpi_u32(b + 26);
    status->decode_p50_us = ledpi_u16(b + 30);
    status->decode_p99_us = ledpi_u16(b + 32);
}

/* 0 is only ever a sender's first number; after 65535 comes 1. A step back means a new sender. */
static inline void ledpi_count_lost(ledpi_receiver *r, uint16_t sequence)
{
    if (r->has_sequence) {
        int32_t missing = (int32_t)sequence - r->sequence - 1;
        if (missing < 0)
            missing += 0xFFFF;
        if (sequence == 0 || missing >= 0x8000)
            r->restarts++;
        else
            r->lost += (uint32_t)missing;
    }
    r->has_sequence = true;
    r->sequence = sequence;
}

/* `r->frame` → `r->message`. The order of the checks is that of docs/wire.md. */
static inline ledpi_fault ledpi_open(ledpi_receiver *r)
{
    uint8_t *const b = r->frame;
    if (r->length > LEDPI_MAX_CODED_BYTES)
        return LEDPI_LENGTH;
    const int8_t count = ledpi_uncobs(b, r->length);
    if (count < 0)
        return LEDPI_COBS;
    if (count < 8) /* a header and a CRC */
        return LEDPI_LENGTH;
    if (ledpi_crc32(b, (uint8_t)(count - 4)) != ledpi_u32(b + count - 4))
        return LEDPI_CRC;
    ledpi_count_lost(r, ledpi_u16(b + 2));
    if (b[0] != LEDPI_VERSION)
        return LEDPI_OTHER_VERSION;
    if (b[1] < LEDPI_MARKER || b[1] > LEDPI_STATUS)
        return LEDPI_OTHER_TYPE;
    if (count != 38)
        return LEDPI_LENGTH;
    if (b[1] == LEDPI_MARKER)
        return ledpi_read_marker(b, &r->message.marker);
    if (b[1] == LEDPI_FIX)
        return ledpi_read_fix(b, &r->message.fix);
    ledpi_read_status(b, &r->message.status);
    return LEDPI_WHOLE;
}

/* Takes in one byte. Says which message it has completed; that one is in `r->message` until the next call.
 *
 * What comes before the first delimiter and is no frame is not counted: it began before we listened. */
static inline ledpi_kind ledpi_feed(ledpi_receiver *r, uint8_t byte)
{
    if (byte != 0) {
        if (r->length < LEDPI_MAX_CODED_BYTES)
            r->frame[r->length] = byte;
        if (r->length <= LEDPI_MAX_CODED_BYTES)
            r->length++;
        return LEDPI_NOTHING;
    }
    const bool joined = r->joined;
    ledpi_kind kind = LEDPI_NOTHING;
    if (r->length > 0) { /* two delimiters in a row separate nothing */
        const ledpi_fault fault = ledpi_open(r);
        if (fault == LEDPI_WHOLE) {
            r->good++;
            kind = (ledpi_kind)r->frame[1];
        } else if (joined || fault > LEDPI_VALUE)
            r->faults[fault]++;
    }
    r->length = 0;
    r->joined = true;
    return kind;
}

/* May the robot drive by what it was told? Only while its newest fix is young, counted from the picture's exposure, and
 * nothing has been said against it since. All zero is its start: no.
 *
 *     static ledpi_guard guard = {.timeout_ms = 300};
 */
typedef struct {
    uint16_t timeout_ms;
    bool has_fix;
    uint32_t exposed_ms; /* by the caller's clock */
} ledpi_guard;

/* Takes in each message that `ledpi_feed` has completed. `now_ms` is any clock of milliseconds; it may wrap. */
static inline void ledpi_guard_take(ledpi_guard *guard, const ledpi_receiver *r, ledpi_kind kind, uint32_t now_ms)
{
    if (kind == LEDPI_FIX) {
        const uint32_t age_ms = r->message.fix.age_us / 1000;
        guard->has_fix = age_ms < guard->timeout_ms;
        guard->exposed_ms = now_ms - age_ms;
    } else if (kind == LEDPI_STATUS && r->message.status.no_fix != LEDPI_HAS_FIX)
        guard->has_fix = false;
}

/* Ask at every tick of the motors' loop: what has once timed out stays so until the next fix, even when the clock wraps. */
static inline bool ledpi_guard_may_drive(ledpi_guard *guard, uint32_t now_ms)
{
    if (guard->has_fix && now_ms - guard->exposed_ms >= guard->timeout_ms)
        guard->has_fix = false;
    return guard->has_fix;
}

#endif
