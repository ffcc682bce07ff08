/* Coverage-guided fuzzing of the C receiver, by clang's libFuzzer; without a compiler that has it, the tests do without.
 *
 *     clang -g -O1 -fsanitize=fuzzer,address,undefined -fno-sanitize-recover=all -Ifirmware/receiver \
 *         tests/builders/receiver_fuzz.c -o build/receiver_fuzz
 *     build/receiver_fuzz -max_total_time=300 -max_len=512
 *
 * A checksum keeps a fuzzer out, so half of the input gets a right one: the first byte of a piece says how long it is,
 * and whether it is given as it is, or as the content of a frame.
 */
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#include "ledpi_receiver.h"

static void hold(bool promise)
{
    if (!promise)
        abort();
}

/* A COBS block: at most 254 bytes that are not 0 in a row, as here: each block's first byte leads to the next one. */
static size_t cobs(const uint8_t *from, size_t count, uint8_t *to)
{
    size_t head = 0, length = 1;
    for (size_t i = 0; i < count; i++) {
        if (from[i] == 0) {
            to[head] = (uint8_t)(length - head);
            head = length++;
        } else
            to[length++] = from[i];
    }
    to[head] = (uint8_t)(length - head);
    return length;
}

/* The header's promises about a message. */
static void check(const ledpi_receiver *r, ledpi_kind kind)
{
    if (kind == LEDPI_STATUS) {
        const ledpi_status *const s = &r->message.status;
        hold(s->state <= LEDPI_STOPPING || s->state == LEDPI_STATE_UNKNOWN);
        hold(s->no_fix <= LEDPI_BEHIND || s->no_fix == LEDPI_NO_FIX_UNKNOWN);
        return;
    }
    if (kind == LEDPI_STATE) {
        const ledpi_state *const s = &r->message.state;
        hold(s->mode <= LEDPI_BY_ODOMETRY && (s->mode == LEDPI_NO_STATE || s->deviations[0] <= 491520));
        return;
    }
    if (kind == LEDPI_TIME_ASK)
        return;
    const bool is_marker = kind == LEDPI_MARKER;
    const ledpi_pose *const pose = is_marker ? &r->message.marker.pose : &r->message.fix.pose;
    if (is_marker) {
        const ledpi_marker *const m = &r->message.marker;
        hold(!(m->uncalibrated && m->has_pose) && !(m->alternate && !m->ambiguous));
        if (!m->has_pose)
            return;
    }
    double norm2 = 0.0;
    for (int i = 0; i < 4; i++)
        norm2 += (pose->quaternion_q15[i] / 32767.0) * (pose->quaternion_q15[i] / 32767.0);
    hold(norm2 > 0.998 * 0.998 && norm2 < 1.002 * 1.002);
    for (int i = 0; i < 3; i++)
        hold(pose->position_100um[i] > -0x800000 && pose->position_100um[i] < 0x800000);
}

static ledpi_receiver receiver;

static void feed(const uint8_t *bytes, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        const uint32_t before = receiver.good;
        const ledpi_kind kind = ledpi_feed(&receiver, bytes[i]);
        hold((kind != LEDPI_NOTHING) == (receiver.good == before + 1));
        hold(kind == LEDPI_NOTHING || bytes[i] == 0);
        if (kind != LEDPI_NOTHING)
            check(&receiver, kind);
    }
}

static void seal(const uint8_t *content, size_t count)
{
    uint8_t sealed[64], coded[80];
    memcpy(sealed, content, count);
    const uint32_t crc = ledpi_crc32(content, (uint8_t)count);
    for (int i = 0; i < 4; i++)
        sealed[count + (size_t)i] = (uint8_t)(crc >> 8 * i);
    size_t length = cobs(sealed, count + 4, coded);
    coded[length++] = 0;
    feed(coded, length);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    memset(&receiver, 0, sizeof receiver);
    while (size > 0) {
        const bool sealed = *data & 1;
        size_t count = *data >> 1 & 63;
        data++, size--;
        if (sealed && count > 40)
            count = 34; /* a body's length, most of the time */
        if (count > size)
            count = size;
        if (sealed)
            seal(data, count);
        else
            feed(data, count);
        data += count, size -= count;
    }
    /* Whatever came: after a delimiter, the next whole frame is received (docs/wire.md's "status, all unknown"). */
    static const uint8_t whole[] = {0x04, 0x01, 0x03, 0x05, 0x23, 0xff, 0xff, 0xff, 0x80, 0xff, 0xff, 0xff, 0xff, 0xff,
                                    0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff,
                                    0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0x57, 0xf6, 0x2d, 0x4c, 0x00};
    feed((const uint8_t[]){0}, 1);
    const uint32_t good = receiver.good;
    feed(whole, sizeof whole);
    hold(receiver.good == good + 1);
    return 0;
}
