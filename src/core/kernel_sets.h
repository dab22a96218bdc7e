/* kernel_sets.h - the same code for each instruction set of a processor, and which of them this one has. */
#ifndef CN_KERNEL_SETS_H
#define CN_KERNEL_SETS_H

/* KERNEL(name, attribute) defines what is picked, `name`, of code compiled with the attribute. `type pick(int
 * most)` then returns the address of the best that this processor has: up to 2 AVX-512, 1 AVX2, 0 neither. */
#if defined(__x86_64__)
#define CN_KERNEL_SETS(KERNEL, type, pick)                                                                   \
    KERNEL(base, )                                                                                           \
    KERNEL(avx2, __attribute__((target("avx2"))))                                                            \
    KERNEL(avx512, __attribute__((target("avx2,avx512f,avx512dq,avx512vl,avx512bw"))))                       \
    type pick(int most)                                                                                      \
    {                                                                                                        \
        __builtin_cpu_init();                                                                                \
        if (most >= 2 && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") &&          \
            __builtin_cpu_supports("avx512vl") && __builtin_cpu_supports("avx512bw"))                        \
            return &avx512;                                                                                  \
        return most >= 1 && __builtin_cpu_supports("avx2") ? &avx2 : &base;                                  \
    }
#else
#define CN_KERNEL_SETS(KERNEL, type, pick)                                                                   \
    KERNEL(base, )                                                                                           \
    type pick(int most)                                                                                      \
    {                                                                                                        \
        (void)most;                                                                                          \
        return &base;                                                                                        \
    }
#endif

#endif
