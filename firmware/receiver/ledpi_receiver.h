/* Receives ledpi's serial stream: bytes in, poses out; and writes what a controller may say. C99, no heap, no library,
 * some 140 bytes of RAM, and 28 for what is written.
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
#define LEDPI_MAX_CODED_BYTES 39                 /* a frame, without its delimiter */
#define LEDPI_UNKNOWN_DEVIATION UINT32_MAX
#define LEDPI_UNKNOWN_TEMPERATURE INT8_MIN       /* all other unknown values are their type's largest */

/* The kind of message that `ledpi_feed` has just completed. */
typedef enum { LEDPI_NOTHING = 0, LEDPI_MARKER = 1, LEDPI_FIX = 2, LEDPI_STATUS = 3, LEDPI_STATE = 4, LEDPI_TIME_ASK = 17 } ledpi_kind;

typedef enum { LEDPI_STARTING, LEDPI_RUNNING, LEDPI_CAMERA_LOST, LEDPI_STOPPING, LEDPI_STATE_UNKNOWN = 255 } ledpi_daemon_state;

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
    uint32_t deviation_100urad[3];   /* rotation about x, y, z */
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
    uint8_t state;  /* a ledpi_daemon_state */
    uint8_t no_fix; /* a ledpi_no_fix */
    uint8_t panels_in_view;
    int8_t temperature_c;
    uint16_t throttling;
    uint16_t decode_p50_us, decode_p99_us;
    uint32_t uptime_s, frames, frames_dropped, markers, packets_dropped;
} ledpi_status;

/* Sources of the state at the moment it holds. LEDPI_BY_PANELS: no odometry was heard, it goes on as it moved. */
typedef enum { LEDPI_NO_STATE, LEDPI_BY_PANELS, LEDPI_BY_ODOMETRY } ledpi_mode;

/* map_from_base_link in the plane; without a state (`mode`) all numbers but the last three mean nothing. */
typedef struct {
    int32_t x_100um, y_100um;
    int16_t yaw_100urad, speed_mm_s, turn_mrad_s; /* to the left; ahead; to the left */
    uint32_t deviations[3];                       /* x and y in 0.1 mm, yaw in 0.1 mrad */
    int8_t correlations_127[3];                   /* x with y, x with yaw, y with yaw; 127 is 1 */
    uint32_t clock_us;                            /* yours, at which it holds, if `has_clock` */
    uint16_t panel_age_ms, way_cm;                /* since the newest panel's picture; 65534: that or more */
    uint8_t mode;                                 /* a ledpi_mode */
    bool has_clock;
    bool contested;                              /* another pose is possible; the deviations span both */
    bool panel_moved;                            /* a panel hangs elsewhere than the map says */
    uint8_t map_resets, relocalisations, panels; /* after a change of the first two, forget older states */
} ledpi_state;

typedef struct {
    union {
        ledpi_marker marker;
        ledpi_fix fix;
        ledpi_status status;
        ledpi_state state;
        uint16_t time_number; /* LEDPI_TIME_ASK's: answer it by `ledpi_write_time` */
    } message;         /* the one that `ledpi_feed` has just completed, until it is called again */
    uint16_t sequence; /* the newest frame's whose CRC was right */
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

static inline ledpi_fault ledpi_read_state(const uint8_t *b, ledpi_state *state)
{
    const uint8_t flags = b[30], mode = flags & 7;
    uint8_t unknown = 0; /* among 11 numbers: all or none */
    if (flags & 0xC0 || mode > LEDPI_BY_ODOMETRY)
        return LEDPI_OTHER_FLAGS;
    state->x_100um = ledpi_i24(b + 4);
    state->y_100um = ledpi_i24(b + 7);
    state->yaw_100urad = (int16_t)ledpi_u16(b + 10);
    state->speed_mm_s = (int16_t)ledpi_u16(b + 12);
    state->turn_mrad_s = (int16_t)ledpi_u16(b + 14);
    ledpi_deviations(b + 16, state->deviations);
    for (uint8_t i = 0; i < 3; i++) {
        state->correlations_127[i] = (int8_t)b[19 + i];
        unknown = (uint8_t)(unknown + (b[16 + i] == 255) + (b[19 + i] == 0x80) + (ledpi_u16(b + 10 + 2 * i) == 0x8000));
    }
    unknown = (uint8_t)(unknown + (state->x_100um == -0x800000L) + (state->y_100um == -0x800000L));
    state->clock_us = ledpi_u32(b + 22);
    state->panel_age_ms = ledpi_u16(b + 26);
    state->way_cm = ledpi_u16(b + 28);
    state->mode = mode;
    state->contested = flags & 8;
    state->panel_moved = flags & 16;
    state->has_clock = !(flags & 32);
    state->map_resets = b[31];
    state->relocalisations = b[32];
    state->panels = b[33];
    if (unknown != (mode == LEDPI_NO_STATE ? 11 : 0))
        return LEDPI_VALUE;
    return mode != LEDPI_NO_STATE && (state->yaw_100urad > 32000 || state->yaw_100urad < -32000) ? LEDPI_VALUE : LEDPI_WHOLE;
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
    if ((b[1] < LEDPI_MARKER || b[1] > LEDPI_STATE) && b[1] != LEDPI_TIME_ASK)
        return LEDPI_OTHER_TYPE;
    if (count != (b[1] == LEDPI_TIME_ASK ? 10 : 38))
        return LEDPI_LENGTH;
    if (b[1] == LEDPI_MARKER)
        return ledpi_read_marker(b, &r->message.marker);
    if (b[1] == LEDPI_FIX)
        return ledpi_read_fix(b, &r->message.fix);
    if (b[1] == LEDPI_STATE)
        return ledpi_read_state(b, &r->message.state);
    if (b[1] == LEDPI_TIME_ASK) {
        r->message.time_number = ledpi_u16(b + 4);
        return LEDPI_WHOLE;
    }
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

/* Messages of a controller: its odometry, 10 to 100 times a second, and answers to each LEDPI_TIME_ASK.
 *
 *     static ledpi_sender sender;                   // all zero is its start
 *     static uint8_t buffer[LEDPI_ODOMETRY_BYTES];  // for either
 *     …
 *     if (ledpi_feed(&receiver, byte) == LEDPI_TIME_ASK) {
 *         const uint32_t arrived_us = micros();     // better: as the interrupt took the byte in
 *         …                                         // whatever else there is to do, while the line is free at last
 *         Serial.write(buffer, ledpi_write_time(buffer, &sender, receiver.message.time_number, arrived_us, micros()));
 *     }
 */
#define LEDPI_ODOMETRY_BYTES 28
#define LEDPI_TIME_BYTES 21
#define LEDPI_NO_TOTAL INT32_MIN

/* Running totals, which may wrap: a lost message loses no way. */
typedef struct {
    uint32_t clock_us;                  /* when they were read; the clock of the answers */
    int32_t left_100um, right_100um;    /* each wheel's way, ahead; LEDPI_NO_TOTAL, both: there are no wheels */
    int32_t yaw_100urad;                /* a gyro's, to the left; LEDPI_NO_TOTAL: there is none */
    bool restarted, lifted, slipping;   /* the totals begin anew; the robot may be anywhere; the wheels tell nothing */
} ledpi_odometry;

typedef struct {
    uint16_t sequence;
} ledpi_sender;

static inline uint8_t *ledpi_put_u32(uint8_t *b, uint32_t value)
{
    for (uint8_t i = 0; i < 4; i++, value >>= 8)
        *b++ = (uint8_t)value;
    return b;
}

/* Makes a frame of the body that begins at buffer + 6 and ends before `end`. Returns its length, a zero ahead counted. */
static inline uint8_t ledpi_seal(uint8_t *buffer, ledpi_sender *sender, uint8_t type, uint8_t *end)
{
    uint8_t *block = buffer + 1; /* COBS in place: each zero, and the byte ahead, say how far it is to the next */
    buffer[0] = 0;
    buffer[2] = LEDPI_VERSION;
    buffer[3] = type;
    buffer[4] = (uint8_t)sender->sequence;
    buffer[5] = (uint8_t)(sender->sequence >> 8);
    sender->sequence = sender->sequence == UINT16_MAX ? 1 : (uint16_t)(sender->sequence + 1);
    end = ledpi_put_u32(end, ledpi_crc32(buffer + 2, (uint8_t)(end - buffer - 2)));
    for (uint8_t *b = buffer + 2; b < end; b++)
        if (*b == 0) {
            *block = (uint8_t)(b - block);
            block = b;
        }
    *block = (uint8_t)(end - block);
    *end = 0;
    return (uint8_t)(end + 1 - buffer);
}

/* Into LEDPI_ODOMETRY_BYTES of `buffer`; returns how many those are. */
static inline uint8_t ledpi_write_odometry(uint8_t *buffer, ledpi_sender *sender, const ledpi_odometry *odometry)
{
    uint8_t *b = ledpi_put_u32(buffer + 6, odometry->clock_us);
    b = ledpi_put_u32(b, (uint32_t)odometry->left_100um);
    b = ledpi_put_u32(b, (uint32_t)odometry->right_100um);
    b = ledpi_put_u32(b, (uint32_t)odometry->yaw_100urad);
    *b++ = (uint8_t)((odometry->restarted ? 1 : 0) | (odometry->lifted ? 2 : 0) | (odometry->slipping ? 4 : 0));
    return ledpi_seal(buffer, sender, 16, b);
}

/* Into LEDPI_TIME_BYTES of `buffer`. `arrived_us`: as the question's last byte came; `left_us`: as this answer's first
 * byte leaves. How long the answer waits between them is no matter, so it may wait for a free line. */
static inline uint8_t ledpi_write_time(uint8_t *buffer, ledpi_sender *sender, uint16_t number, uint32_t arrived_us, uint32_t left_us)
{
    uint8_t *b = ledpi_put_u32(ledpi_put_u32(buffer + 8, arrived_us), left_us);
    buffer[6] = (uint8_t)number;
    buffer[7] = (uint8_t)(number >> 8);
    return ledpi_seal(buffer, sender, 18, b);
}

#endif
