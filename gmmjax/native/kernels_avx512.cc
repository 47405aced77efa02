#if defined(__x86_64__)
#include <cstdint>
#include <cstring>
#include <limits>
#include <type_traits>
#if defined(__clang__)
#pragma clang attribute push(__attribute__((target("avx512f,avx512dq,avx512bw,avx512vl,avx2,fma"))), apply_to = function)
#else
#pragma GCC target("avx512f,avx512dq,avx512bw,avx512vl,avx2,fma")
#endif
#define GMMJAX_INSTRUCTION_SET avx512
#define GMMJAX_VECTOR_BYTES 64
#include "vectors.h"

#include "cylinders_kernel.h"
#include "expectation_kernel.h"
#include "transport_kernel.h"
#if defined(__clang__)
#pragma clang attribute pop
#endif
#endif
