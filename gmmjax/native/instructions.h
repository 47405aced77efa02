// Which of a kernel's versions this machine runs.

#pragma once

#include <cstdlib>
#include <string>

namespace gmmjax {

enum class Instructions { baseline, avx2, avx512 };

// The widest vectors that this machine has, and that GMMJAX_INSTRUCTIONS (baseline, avx2, avx512) allows.
inline Instructions instructions() {
#if defined(__x86_64__)
  const char* setting = std::getenv("GMMJAX_INSTRUCTIONS");
  const std::string most = setting == nullptr ? "avx512" : setting;
  __builtin_cpu_init();
  const bool has_avx2 = __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma");
  const bool has_avx512 = has_avx2 && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") &&
                          __builtin_cpu_supports("avx512bw") && __builtin_cpu_supports("avx512vl");
  if (has_avx512 && most == "avx512") return Instructions::avx512;
  if (has_avx2 && most != "baseline") return Instructions::avx2;
#endif
  return Instructions::baseline;
}

// The version of a function that exists in every namespace of an instruction set, as a pointer of this type.
#if defined(__x86_64__)
#define GMMJAX_VERSION(type, function)                                         \
  (instructions() == Instructions::avx512 ? static_cast<type>(avx512::function) \
   : instructions() == Instructions::avx2 ? static_cast<type>(avx2::function)   \
                                          : static_cast<type>(baseline::function))
#else
#define GMMJAX_VERSION(type, function) static_cast<type>(baseline::function)
#endif

}  // namespace gmmjax
