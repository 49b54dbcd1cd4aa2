/* FMI 3 functions that no model here provides: all are there, and all refuse.

   Without the header, so that one macro does for all signatures. */
#include "instance.h"

#define REFUSED(NAME)                                                                              \
    int fmi3##NAME(Instance *m) { return instance_fail(m, "fmi3" #NAME " is not provided"); }

REFUSED(EnterConfigurationMode)
REFUSED(ExitConfigurationMode)
REFUSED(EvaluateDiscreteStates)
REFUSED(GetAdjointDerivative)
REFUSED(GetIntervalFraction)
REFUSED(GetNumberOfVariableDependencies)
REFUSED(GetOutputDerivatives)
REFUSED(GetShiftDecimal)
REFUSED(GetShiftFraction)
REFUSED(GetVariableDependencies)
REFUSED(SetIntervalDecimal)
REFUSED(SetIntervalFraction)
REFUSED(SetShiftDecimal)
REFUSED(SetShiftFraction)

#ifndef MINIMAL /* model exchange: an FMU without it need not have them */
REFUSED(CompletedIntegratorStep)
REFUSED(EnterContinuousTimeMode)
REFUSED(GetContinuousStateDerivatives)
REFUSED(GetContinuousStates)
REFUSED(GetEventIndicators)
REFUSED(GetNominalsOfContinuousStates)
REFUSED(GetNumberOfContinuousStates)
REFUSED(GetNumberOfEventIndicators)
REFUSED(SetContinuousStates)
REFUSED(SetTime)
#endif
