/* QEMU plugin: instructions executed inside a range of addresses, from one entry of a function to the
 * next.  A second way to count a step, to hold the timer's count against.
 *
 *   gcc -shared -fPIC count_instructions.c -o count.so
 *   qemu-system-arm ... -d plugin -plugin ./count.so,entry=0x8000101,low=0x8000100,high=0x8000900
 *
 * Prints "entries E instructions N min A max B" at the end: N counts what ran inside [low, high).  With
 * each=1 also "run N" for each entry, what ran from it to the next.
 *
 * Debian ships no header for the plugin interface (version 1), so it is declared here.
 *
 * License: MIT. */
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

typedef uint64_t qemu_plugin_id_t;
struct qemu_plugin_tb;
struct qemu_plugin_insn;
typedef void (*insn_fn)(unsigned int cpu, void *data);

void qemu_plugin_register_vcpu_tb_trans_cb(qemu_plugin_id_t id, void (*fn)(qemu_plugin_id_t, struct qemu_plugin_tb *));
void qemu_plugin_register_vcpu_insn_exec_cb(struct qemu_plugin_insn *insn, insn_fn fn, int flags, void *data);
void qemu_plugin_register_atexit_cb(qemu_plugin_id_t id, void (*fn)(qemu_plugin_id_t, void *), void *data);
size_t qemu_plugin_tb_n_insns(const struct qemu_plugin_tb *tb);
struct qemu_plugin_insn *qemu_plugin_tb_get_insn(const struct qemu_plugin_tb *tb, size_t i);
uint64_t qemu_plugin_insn_vaddr(const struct qemu_plugin_insn *insn);
void qemu_plugin_outs(const char *text);

int qemu_plugin_version = 1;

static uint64_t entry, low, high, entries, instructions, smallest = UINT64_MAX, largest, this_entry, each;

static void close_entry(void)
{
    char text[40];

    if (entries == 0)
        return;
    smallest = this_entry < smallest ? this_entry : smallest;
    largest = this_entry > largest ? this_entry : largest;
    instructions += this_entry;
    if (each) {
        snprintf(text, sizeof text, "run %llu\n", (unsigned long long)this_entry);
        qemu_plugin_outs(text);
    }
    this_entry = 0;
}

static void on_entry(unsigned int cpu, void *data)
{
    (void)cpu;
    (void)data;
    close_entry();
    ++entries;
}

static void on_instruction(unsigned int cpu, void *data)
{
    (void)cpu;
    (void)data;
    this_entry += entries != 0;
}

static void on_translation(qemu_plugin_id_t id, struct qemu_plugin_tb *tb)
{
    size_t i;

    (void)id;
    for (i = 0; i < qemu_plugin_tb_n_insns(tb); ++i) {
        struct qemu_plugin_insn *insn = qemu_plugin_tb_get_insn(tb, i);
        const uint64_t at = qemu_plugin_insn_vaddr(insn);

        if (at == entry)
            qemu_plugin_register_vcpu_insn_exec_cb(insn, on_entry, 0, NULL);
        if (at >= low && at < high)
            qemu_plugin_register_vcpu_insn_exec_cb(insn, on_instruction, 0, NULL);
    }
}

static void at_exit(qemu_plugin_id_t id, void *data)
{
    char text[160];

    (void)id;
    (void)data;
    close_entry();
    snprintf(text, sizeof text, "entries %llu instructions %llu min %llu max %llu\n", (unsigned long long)entries,
             (unsigned long long)instructions, (unsigned long long)smallest, (unsigned long long)largest);
    qemu_plugin_outs(text);
}

int qemu_plugin_install(qemu_plugin_id_t id, const void *info, int argc, char **argv)
{
    int i;

    (void)info;
    for (i = 0; i < argc; ++i) {
        if (strncmp(argv[i], "entry=", 6) == 0)
            entry = strtoull(argv[i] + 6, NULL, 0) & ~1ull;
        if (strncmp(argv[i], "low=", 4) == 0)
            low = strtoull(argv[i] + 4, NULL, 0) & ~1ull;
        if (strncmp(argv[i], "high=", 5) == 0)
            high = strtoull(argv[i] + 5, NULL, 0) & ~1ull;
        if (strncmp(argv[i], "each=", 5) == 0)
            each = strtoull(argv[i] + 5, NULL, 0);
    }
    qemu_plugin_register_vcpu_tb_trans_cb(id, on_translation);
    qemu_plugin_register_atexit_cb(id, at_exit, NULL);
    return 0;
}
