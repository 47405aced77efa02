#define GMMJAX_INSTRUCTION_SET baseline
#include "expectation_kernel.h"
