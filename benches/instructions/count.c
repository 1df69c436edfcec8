/* Counts the instructions of a program for another processor: a plugin of QEMU's user mode.
 *
 *     cc -O2 -shared -fPIC -o count.so benches/instructions/count.c
 *     qemu-aarch64 -plugin ./count.so,blocks=counts.txt lightpath render scan.ply --threads 1
 *
 * Prints the number of instructions to stderr. Writes a line for each block of instructions that
 * was executed: its address, its length, and how often it ran. Exact for one thread. QEMU must be
 * linked dynamically (Debian 12: qemu-user, not qemu-user-static).
 */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* The part of QEMU's qemu-plugin.h that is used here, version 1 of the interface. */
typedef uint64_t plugin_id;
struct qemu_plugin_tb;
size_t qemu_plugin_tb_n_insns(const struct qemu_plugin_tb *);
uint64_t qemu_plugin_tb_vaddr(const struct qemu_plugin_tb *);
void qemu_plugin_register_vcpu_tb_trans_cb(plugin_id, void (*)(plugin_id, struct qemu_plugin_tb *));
void qemu_plugin_register_vcpu_tb_exec_inline(struct qemu_plugin_tb *, int add, void *, uint64_t);
void qemu_plugin_register_atexit_cb(plugin_id, void (*)(plugin_id, void *), void *);

__attribute__((visibility("default"))) int qemu_plugin_version = 1;

struct block {
    uint64_t address, length, runs;
    struct block *next;
};

static struct block *blocks;
static const char *path;

static void translated(plugin_id id, struct qemu_plugin_tb *tb) {
    (void)id;
    struct block *block = malloc(sizeof *block);
    if (!block)
        abort();
    *block = (struct block){qemu_plugin_tb_vaddr(tb), qemu_plugin_tb_n_insns(tb), 0, blocks};
    blocks = block;
    qemu_plugin_register_vcpu_tb_exec_inline(tb, 0, &block->runs, 1);
}

static void at_exit(plugin_id id, void *unused) {
    (void)id;
    (void)unused;
    uint64_t sum = 0;
    FILE *file = path ? fopen(path, "w") : NULL;
    for (struct block *block = blocks; block; block = block->next) {
        sum += block->length * block->runs;
        if (file)
            fprintf(file, "%" PRIx64 " %" PRIu64 " %" PRIu64 "\n", block->address, block->length,
                    block->runs);
    }
    if (file)
        fclose(file);
    fprintf(stderr, "%" PRIu64 " instructions\n", sum);
}

__attribute__((visibility("default"))) int qemu_plugin_install(plugin_id id, const void *info,
                                                               int argc, char **argv) {
    (void)info;
    static const char key[] = "blocks=";
    if (argc > 0 && !strncmp(argv[0], key, sizeof key - 1))
        path = argv[0] + sizeof key - 1;
    qemu_plugin_register_vcpu_tb_trans_cb(id, translated);
    qemu_plugin_register_atexit_cb(id, at_exit, NULL);
    return 0;
}
