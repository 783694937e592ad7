/* A Simulink block (Level 2 S-function) that computes contact forces. Build it in MATLAB with

       mex graspforce_sfun.c -I/where/it/went/include -L/where/it/went/lib -lgraspforce

   Parameters: the contacts' models (1 FPC, 3 PCWF, 4 SFC), their friction coefficients mu, their
   largest normal forces c_max [N], alpha. Inputs: W (6 × m, as MATLAB has it, by columns), f (6),
   engagement (one a contact). Outputs: c (m) and the status (0 is SOLVED). A step that is not
   SOLVED keeps the last forces that were. */
#define S_FUNCTION_NAME graspforce_sfun
#define S_FUNCTION_LEVEL 2
#include "graspforce.h"
#include "simstruc.h"

enum { MODELS, MU, C_MAX, ALPHA, PARAMETERS };
enum { W, F, ENGAGEMENT, INPUTS };
enum { C, STATUS, OUTPUTS };

static int contacts(SimStruct* S) { return (int)mxGetNumberOfElements(ssGetSFcnParam(S, MODELS)); }
static double parameter(SimStruct* S, int which, int i) {
  return mxGetPr(ssGetSFcnParam(S, which))[i];
}
static int components(SimStruct* S) {
  int m = 0;
  for (int i = 0; i < contacts(S); ++i) m += (int)parameter(S, MODELS, i);
  return m;
}

static void mdlInitializeSizes(SimStruct* S) {
  ssSetNumSFcnParams(S, PARAMETERS);
  if (ssGetNumSFcnParams(S) != ssGetSFcnParamsCount(S)) return;
  if (!ssSetNumInputPorts(S, INPUTS) || !ssSetNumOutputPorts(S, OUTPUTS)) return;
  ssSetInputPortMatrixDimensions(S, W, 6, components(S));
  ssSetInputPortWidth(S, F, 6);
  ssSetInputPortWidth(S, ENGAGEMENT, contacts(S));
  for (int port = 0; port < INPUTS; ++port) {
    ssSetInputPortRequiredContiguous(S, port, 1);
    ssSetInputPortDirectFeedThrough(S, port, 1);
  }
  ssSetOutputPortWidth(S, C, components(S));
  ssSetOutputPortWidth(S, STATUS, 1);
  ssSetNumSampleTimes(S, 1);
  ssSetNumPWork(S, 1); /* the servo */
}

static void mdlInitializeSampleTimes(SimStruct* S) {
  ssSetSampleTime(S, 0, INHERITED_SAMPLE_TIME);
  ssSetOffsetTime(S, 0, 0.0);
}

#define MDL_START
static void mdlStart(SimStruct* S) {
  int models[256];
  const int n = contacts(S);
  if (n > 256) {
    ssSetErrorStatus(S, "graspforce: more than 256 contacts");
    return;
  }
  for (int i = 0; i < n; ++i) models[i] = (int)parameter(S, MODELS, i);
  graspforce_servo* servo = graspforce_create(6, n, models, 0, 0, "c_max");
  ssGetPWork(S)[0] = servo;
  if (servo == NULL) {
    ssSetErrorStatus(S, graspforce_error());
    return;
  }
  for (int i = 0; i < n; ++i) {
    graspforce_field(servo, "mu", NULL, NULL)[i] = parameter(S, MU, i);
    graspforce_field(servo, "c_max", NULL, NULL)[i] = parameter(S, C_MAX, i);
  }
  *graspforce_field(servo, "alpha", NULL, NULL) = parameter(S, ALPHA, 0);
}

static void mdlOutputs(SimStruct* S, int_T task) {
  graspforce_servo* servo = ssGetPWork(S)[0];
  const int n = contacts(S), m = components(S);
  const real_T* map = ssGetInputPortRealSignal(S, W);
  double* rows = graspforce_field(servo, "W", NULL, NULL);
  for (int r = 0; r < 6; ++r)
    for (int j = 0; j < m; ++j) rows[r * m + j] = map[j * 6 + r];
  double* f = graspforce_field(servo, "f", NULL, NULL);
  for (int r = 0; r < 6; ++r) f[r] = ssGetInputPortRealSignal(S, F)[r];
  double* engagement = graspforce_field(servo, "engagement", NULL, NULL);
  for (int i = 0; i < n; ++i) engagement[i] = ssGetInputPortRealSignal(S, ENGAGEMENT)[i];

  const graspforce_status status = graspforce_tick(servo);
  if (status == GRASPFORCE_SOLVED)
    for (int j = 0; j < m; ++j) ssGetOutputPortRealSignal(S, C)[j] = graspforce_forces(servo)[j];
  ssGetOutputPortRealSignal(S, STATUS)[0] = status;
  (void)task;
}

static void mdlTerminate(SimStruct* S) { graspforce_destroy(ssGetPWork(S)[0]); }

#ifdef MATLAB_MEX_FILE
#include "simulink.c"
#else
#include "cg_sfun.h"
#endif
