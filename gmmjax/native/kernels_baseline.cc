#define GMMJAX_INSTRUCTION_SET baseline
#define GMMJAX_VECTOR_BYTES 16
#include "vectors.h"

#include "cylinders_kernel.h"
#include "expectation_kernel.h"
#include "transport_kernel.h"
