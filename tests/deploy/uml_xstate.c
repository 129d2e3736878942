/* User-Mode Linux 6.1 keeps 832 bytes of a process's vector registers (up to AVX), and Linux
 * refuses to set them on a processor whose full state is larger (AVX-512, AMX): its first process
 * dies with "ptrace set fp regs failed, errno = 14". Preloaded, this keeps the rest beside
 * User-Mode Linux's own buffer, so that the state is always set whole. */
#define _GNU_SOURCE
#include <elf.h>
#include <stdarg.h>
#include <stdint.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/ptrace.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <unistd.h>

enum { STATE_BYTES = 16384, BUFFERS = 16384, FEATURES_OFFSET = 512, X87_SSE_AVX = 7 };

struct rest {
    const void *buffer; /* User-Mode Linux's, one per guest thread */
    unsigned char state[STATE_BYTES];
};

static struct rest *rest_of(const void *buffer, int create)
{
    static struct rest *table;
    if (!table)
        table = mmap(NULL, sizeof(struct rest) * BUFFERS, PROT_READ | PROT_WRITE,
                     MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
    if (table == MAP_FAILED)
        return NULL;
    size_t start = ((uintptr_t)buffer >> 6) * 2654435761u;
    for (size_t step = 0; step < BUFFERS; step++) {
        struct rest *rest = &table[(start + step) % BUFFERS];
        if (rest->buffer == buffer)
            return rest;
        if (!rest->buffer) {
            if (!create)
                return NULL;
            rest->buffer = buffer;
            return rest;
        }
    }
    return NULL;
}

static long raw(long request, long pid, void *address, void *data)
{
    return syscall(SYS_ptrace, request, pid, address, data);
}

long ptrace(enum __ptrace_request request, ...)
{
    va_list arguments;
    va_start(arguments, request);
    pid_t pid = va_arg(arguments, pid_t);
    void *address = va_arg(arguments, void *);
    void *data = va_arg(arguments, void *);
    va_end(arguments);

    if (request >= PTRACE_PEEKTEXT && request <= PTRACE_PEEKUSER) { /* returns the word itself */
        long word = 0;
        long result = raw(request, pid, address, &word);
        return result < 0 ? result : word;
    }
    int set = request == PTRACE_SETREGSET;
    if ((!set && request != PTRACE_GETREGSET) || (uintptr_t)address != NT_X86_XSTATE)
        return raw(request, pid, address, data);

    static unsigned char whole[STATE_BYTES];
    struct iovec *asked = data;
    struct iovec all = {whole, sizeof whole};
    long result = raw(PTRACE_GETREGSET, pid, address, &all);
    if (result < 0 || all.iov_len <= asked->iov_len)
        return raw(request, pid, address, data);
    size_t own = asked->iov_len, beyond = all.iov_len - own;
    struct rest *rest = rest_of(asked->iov_base, !set);
    if (!set) {
        memcpy(asked->iov_base, whole, own);
        if (rest)
            memcpy(rest->state, whole + own, beyond);
        return result;
    }
    memcpy(whole, asked->iov_base, own);
    if (rest) {
        memcpy(whole + own, rest->state, beyond);
    } else { /* a thread not seen yet: the larger registers are in their initial state */
        uint64_t features;
        memcpy(&features, whole + FEATURES_OFFSET, sizeof features);
        features &= X87_SSE_AVX;
        memcpy(whole + FEATURES_OFFSET, &features, sizeof features);
    }
    return raw(PTRACE_SETREGSET, pid, address, &all);
}
