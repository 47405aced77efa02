#define GMMJAX_INSTRUCTION_SET baseline
#include "vectors.h"

#include "cylinders_kernel.h"
#include "expectation_kernel.h"
#include "transport_kernel.h"
