/* receiver_fuzz.c for compilers without libFuzzer: random inputs, some of whose frames have a right checksum.
 *
 *     gcc -O1 -fsanitize=address,undefined -fno-sanitize-recover=all -Ifirmware/receiver tests/receiver_fuzz_loop.c
 *     ./a.out SECONDS SEED
 */
#include <stdio.h>
#include <time.h>

#include "receiver_fuzz.c"

static uint64_t state;

static uint32_t below(uint32_t count) /* xorshift64* */
{
    state ^= state >> 12;
    state ^= state << 25;
    state ^= state >> 27;
    return (uint32_t)((state * 0x2545f4914f6cdd1dULL) >> 32) % count;
}

int main(int argc, char **argv)
{
    if (argc != 3)
        return 2;
    const time_t end = time(NULL) + atol(argv[1]);
    state = 0x9e3779b97f4a7c15ULL + strtoull(argv[2], NULL, 10);
    unsigned long inputs = 0;
    for (; inputs % 1024 || time(NULL) < end; inputs++) {
        uint8_t data[3 * 35 + 100];
        size_t length = 0;
        for (uint32_t sealed = below(4); sealed > 0; sealed--) { /* as long as a body is, of a kind that exists */
            data[length++] = 34 << 1 | 1;
            data[length++] = 1;
            data[length++] = (uint8_t)(1 + below(3));
            for (int i = 0; i < 32; i++)
                data[length++] = (uint8_t)(below(4) ? below(256) : 0);
        }
        for (uint32_t loose = below(100); loose > 0; loose--)
            data[length++] = (uint8_t)below(256);
        LLVMFuzzerTestOneInput(data, length);
    }
    printf("inputs=%lu\n", inputs);
    return 0;
}
