// The functions of FMI 3.0 that a library must export although this component does not support them.
#include "fmi3Functions.h"
#include "fmus/shell/instance.hpp"

namespace {

fmi3Status unsupported(fmi3Instance handle, const char* call) {
  if (handle != nullptr) rotordx::fail(*static_cast<rotordx::Instance*>(handle), "%s is not supported", call);
  return fmi3Error;
}

/// Reading or writing no variables of a type succeeds, also if there are none.
fmi3Status none(fmi3Instance handle, size_t count, const char* call) {
  return count == 0 ? fmi3OK : unsupported(handle, call);
}

}  // namespace

using References = const fmi3ValueReference[];

// Getter and setter of a variable type that no port has.
#define ROTORDX_NO_VARIABLES_OF(type)                                                               \
  fmi3Status fmi3Get##type(fmi3Instance handle, References, size_t n, fmi3##type[], size_t) {       \
    return none(handle, n, "fmi3Get" #type);                                                        \
  }                                                                                                 \
  fmi3Status fmi3Set##type(fmi3Instance handle, References, size_t n, const fmi3##type[], size_t) { \
    return none(handle, n, "fmi3Set" #type);                                                        \
  }

// Any other function; the arguments after the instance are not looked at.
#define ROTORDX_UNSUPPORTED(name, ...) \
  fmi3Status name(fmi3Instance handle, ##__VA_ARGS__) { return unsupported(handle, #name); }

extern "C" {

ROTORDX_NO_VARIABLES_OF(Float32)
ROTORDX_NO_VARIABLES_OF(Int8)
ROTORDX_NO_VARIABLES_OF(UInt8)
ROTORDX_NO_VARIABLES_OF(Int16)
ROTORDX_NO_VARIABLES_OF(UInt16)
ROTORDX_NO_VARIABLES_OF(Int32)
ROTORDX_NO_VARIABLES_OF(UInt32)
ROTORDX_NO_VARIABLES_OF(UInt64)
ROTORDX_NO_VARIABLES_OF(Boolean)
ROTORDX_NO_VARIABLES_OF(String)

fmi3Status fmi3GetBinary(fmi3Instance handle, References, size_t n, size_t[], fmi3Binary[], size_t) {
  return none(handle, n, "fmi3GetBinary");
}

fmi3Status fmi3SetBinary(fmi3Instance handle, References, size_t n, const size_t[], const fmi3Binary[], size_t) {
  return none(handle, n, "fmi3SetBinary");
}

fmi3Status fmi3GetClock(fmi3Instance handle, References, size_t n, fmi3Clock[]) {
  return none(handle, n, "fmi3GetClock");
}

fmi3Status fmi3SetClock(fmi3Instance handle, References, size_t n, const fmi3Clock[]) {
  return none(handle, n, "fmi3SetClock");
}

// Events, clocks and scheduled execution.
ROTORDX_UNSUPPORTED(fmi3EnterEventMode)
ROTORDX_UNSUPPORTED(fmi3EnterStepMode)
ROTORDX_UNSUPPORTED(fmi3EnterConfigurationMode)
ROTORDX_UNSUPPORTED(fmi3ExitConfigurationMode)
ROTORDX_UNSUPPORTED(fmi3EvaluateDiscreteStates)
ROTORDX_UNSUPPORTED(fmi3UpdateDiscreteStates, fmi3Boolean*, fmi3Boolean*, fmi3Boolean*, fmi3Boolean*, fmi3Boolean*,
                    fmi3Float64*)
ROTORDX_UNSUPPORTED(fmi3GetIntervalDecimal, References, size_t, fmi3Float64[], fmi3IntervalQualifier[])
ROTORDX_UNSUPPORTED(fmi3GetIntervalFraction, References, size_t, fmi3UInt64[], fmi3UInt64[], fmi3IntervalQualifier[])
ROTORDX_UNSUPPORTED(fmi3GetShiftDecimal, References, size_t, fmi3Float64[])
ROTORDX_UNSUPPORTED(fmi3GetShiftFraction, References, size_t, fmi3UInt64[], fmi3UInt64[])
ROTORDX_UNSUPPORTED(fmi3SetIntervalDecimal, References, size_t, const fmi3Float64[])
ROTORDX_UNSUPPORTED(fmi3SetIntervalFraction, References, size_t, const fmi3UInt64[], const fmi3UInt64[])
ROTORDX_UNSUPPORTED(fmi3SetShiftDecimal, References, size_t, const fmi3Float64[])
ROTORDX_UNSUPPORTED(fmi3SetShiftFraction, References, size_t, const fmi3UInt64[], const fmi3UInt64[])
ROTORDX_UNSUPPORTED(fmi3ActivateModelPartition, fmi3ValueReference, fmi3Float64)

// Derivatives and dependencies beyond those in the model description.
ROTORDX_UNSUPPORTED(fmi3GetNumberOfVariableDependencies, fmi3ValueReference, size_t*)
ROTORDX_UNSUPPORTED(fmi3GetVariableDependencies, fmi3ValueReference, size_t[], fmi3ValueReference[], size_t[],
                    fmi3DependencyKind[], size_t)
ROTORDX_UNSUPPORTED(fmi3GetDirectionalDerivative, References, size_t, References, size_t, const fmi3Float64[], size_t,
                    fmi3Float64[], size_t)
ROTORDX_UNSUPPORTED(fmi3GetAdjointDerivative, References, size_t, References, size_t, const fmi3Float64[], size_t,
                    fmi3Float64[], size_t)
ROTORDX_UNSUPPORTED(fmi3GetOutputDerivatives, References, size_t, const fmi3Int32[], fmi3Float64[], size_t)

// Model exchange.
ROTORDX_UNSUPPORTED(fmi3EnterContinuousTimeMode)
ROTORDX_UNSUPPORTED(fmi3CompletedIntegratorStep, fmi3Boolean, fmi3Boolean*, fmi3Boolean*)
ROTORDX_UNSUPPORTED(fmi3SetTime, fmi3Float64)
ROTORDX_UNSUPPORTED(fmi3SetContinuousStates, const fmi3Float64[], size_t)
ROTORDX_UNSUPPORTED(fmi3GetContinuousStateDerivatives, fmi3Float64[], size_t)
ROTORDX_UNSUPPORTED(fmi3GetEventIndicators, fmi3Float64[], size_t)
ROTORDX_UNSUPPORTED(fmi3GetContinuousStates, fmi3Float64[], size_t)
ROTORDX_UNSUPPORTED(fmi3GetNominalsOfContinuousStates, fmi3Float64[], size_t)
ROTORDX_UNSUPPORTED(fmi3GetNumberOfEventIndicators, size_t*)
ROTORDX_UNSUPPORTED(fmi3GetNumberOfContinuousStates, size_t*)

}  // extern "C"
