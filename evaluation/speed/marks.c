/* A plugin of qemu-user: how many instructions the emulated program has executed at each of its marks (counting.py).
 *
 * Debian 12's qemu-user (7.2) takes plugins, but brings no header; so what is used of it is declared here. One thread only. */
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

#define EXPORTED __attribute__((visibility("default")))
enum { MARK = -20815, ADD_U64 = 0 };

typedef uint64_t Id;
typedef struct Block Block;
void qemu_plugin_register_vcpu_tb_trans_cb(Id, void (*)(Id, Block *));
void qemu_plugin_register_vcpu_tb_exec_inline(Block *, int, void *, uint64_t);
size_t qemu_plugin_tb_n_insns(const Block *);
void qemu_plugin_register_vcpu_syscall_cb(Id, void (*)(Id, unsigned, int64_t, uint64_t, uint64_t, uint64_t, uint64_t, uint64_t,
                                                       uint64_t, uint64_t, uint64_t));

EXPORTED int qemu_plugin_version = 1;

static uint64_t executed;

static void translated(Id id, Block *block) {
    (void)id;
    qemu_plugin_register_vcpu_tb_exec_inline(block, ADD_U64, &executed, qemu_plugin_tb_n_insns(block));
}

static void called(Id id, unsigned cpu, int64_t call, uint64_t first, uint64_t b, uint64_t c, uint64_t d, uint64_t e, uint64_t f,
                   uint64_t g, uint64_t h) {
    (void)id, (void)cpu, (void)call, (void)b, (void)c, (void)d, (void)e, (void)f, (void)g, (void)h;
    if ((int32_t)first == MARK) fprintf(stderr, "mark %llu\n", (unsigned long long)executed);
}

EXPORTED int qemu_plugin_install(Id id, const void *info, int count, char **arguments) {
    (void)info, (void)count, (void)arguments;
    qemu_plugin_register_vcpu_tb_trans_cb(id, translated);
    qemu_plugin_register_vcpu_syscall_cb(id, called);
    return 0;
}
