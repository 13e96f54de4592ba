/* labkit's constitutive model as a behaviour that MGIS loads (MFrontGenericInterfaceSupport, API version 1).
 *
 * mgis.behaviour.load("liblabkit_umat.so", "labkit", Hypothesis). Strain, stress and the tensors A, F, Ft are in TFEL's
 * order and scaling (xx, yy, zz, sqrt2 xy, sqrt2 xz, sqrt2 yz). Strain and stress: tension positive; A, F, Ft:
 * compression positive, as in UMAT. The law itself is in labkit_umat.f90.
 */
#include <stdio.h>
#include <string.h>

enum { PROPERTIES = 30, STATE = 21 }; /* labkit umat writes 51 for a model that is not the paper's */

/* The structures of MGIS/Behaviour/BehaviourDataView.hxx and StateView.hxx */
typedef struct {
  const double *gradients, *thermodynamic_forces, *mass_density, *material_properties, *internal_state_variables;
  const double *stored_energy, *dissipated_energy, *external_state_variables;
} InitialState;

typedef struct {
  const double *gradients;
  double *thermodynamic_forces;
  const double *mass_density, *material_properties;
  double *internal_state_variables, *stored_energy, *dissipated_energy;
  const double *external_state_variables;
} FinalState;

typedef struct {
  char *error_message;
  double dt, *K, *rdt, *speed_of_sound;
  InitialState s0;
  FinalState s1;
} BehaviourData;

/* labkit_umat.f90 */
void labkit_update(int n, int nprops, const double *props, double *state, const double *increment, int with_tangent,
                   double *stress, double *tangent, int *status, int *substeps);
int labkit_initial_state(int nprops, const double *props, const double *stress, double *state);

static const int PLACE[6] = {0, 1, 2, 5, 4, 3}; /* index of xx, yy, zz, xy, xz, yz in the order of the law */

static void to_law(const double *tfel, int n, double sign, double *law) {
  for (int i = 0; i < 6; ++i) law[i] = 0.0;
  for (int i = 0; i < n; ++i) law[PLACE[i]] = sign * tfel[i];
}

static void from_law(const double *law, int n, double sign, double *tfel) {
  for (int i = 0; i < n; ++i) tfel[i] = sign * law[PLACE[i]];
}

static int failed(BehaviourData *d, int status) {
  if (d->error_message) snprintf(d->error_message, 512, "labkit: status %d, see docs/umat.md", status);
  if (d->rdt && *d->rdt > 0.25) *d->rdt = 0.25;
  return -1;
}

/* Integrate one point with tensors of n components; returns 1, or -1 if the increment failed. */
static int integrate(BehaviourData *d, int n) {
  double state[STATE], increment[6], stress[6], tangent[36];
  const double kind = d->K[0] > 50.0 ? d->K[0] - 100.0 : d->K[0];
  const int predicts = kind < -0.5, with_tangent = predicts || kind > 0.5;
  int status = 0, substeps;
  const double *before = d->s0.internal_state_variables, *props = d->s1.material_properties;
  if (d->K[0] > 50.0 && d->speed_of_sound) *d->speed_of_sound = 0.0;
  if (before[0] == 0.0) {
    to_law(d->s0.thermodynamic_forces, n, -1.0, stress);
    status = labkit_initial_state(PROPERTIES, props, stress, state);
    if (status) return failed(d, status);
  } else {
    memcpy(state, before, 3 * sizeof(double));
    for (int t = 0; t < 3; ++t) to_law(before + 3 + t * n, n, 1.0, state + 3 + 6 * t);
  }
  for (int i = 0; i < 6; ++i) increment[i] = 0.0;
  if (!predicts)
    for (int i = 0; i < n; ++i) increment[PLACE[i]] = d->s0.gradients[i] - d->s1.gradients[i];
  labkit_update(1, PROPERTIES, props, state, increment, with_tangent, stress, tangent, &status, &substeps);
  if (status) return failed(d, status);
  if (with_tangent)
    for (int i = 0; i < n; ++i)
      for (int j = 0; j < n; ++j) d->K[i * n + j] = tangent[PLACE[i] * 6 + PLACE[j]];
  if (!predicts) {
    from_law(stress, n, -1.0, d->s1.thermodynamic_forces);
    memcpy(d->s1.internal_state_variables, state, 3 * sizeof(double));
    for (int t = 0; t < 3; ++t) from_law(state + 3 + 6 * t, n, 1.0, d->s1.internal_state_variables + 3 + t * n);
  }
  return 1;
}

int labkit_AxisymmetricalGeneralisedPlaneStrain(BehaviourData *d) { return integrate(d, 3); }
int labkit_Axisymmetrical(BehaviourData *d) { return integrate(d, 4); }
int labkit_PlaneStrain(BehaviourData *d) { return integrate(d, 4); }
int labkit_GeneralisedPlaneStrain(BehaviourData *d) { return integrate(d, 4); }
int labkit_Tridimensional(BehaviourData *d) { return integrate(d, 6); }

/* What MGIS asks of a behaviour: src/LibrariesManager.cxx */
const unsigned short labkit_api_version = 1;
const char *labkit_mfront_ept = "labkit";
const char *labkit_mfront_interface = "Generic";
const char *labkit_src = "labkit_umat.f90";
const char *labkit_author = "labkit";
const char *labkit_unit_system = "";
const unsigned short labkit_mfront_mkt = 1; /* a behaviour */
const unsigned short labkit_BehaviourType = 1; /* strain based */
const unsigned short labkit_BehaviourKinematic = 1; /* small strains */
const unsigned short labkit_SymmetryType = 0;
const unsigned short labkit_ElasticSymmetryType = 0;
const unsigned short labkit_TemperatureRemovedFromExternalStateVariables = 0;
const unsigned short labkit_requiresStiffnessTensor = 0;
const unsigned short labkit_requiresThermalExpansionCoefficientTensor = 0;
const unsigned short labkit_ComputesInternalEnergy = 0;
const unsigned short labkit_ComputesDissipatedEnergy = 0;
const unsigned short labkit_nModellingHypotheses = 5;
const char *labkit_ModellingHypotheses[] = {
    "AxisymmetricalGeneralisedPlaneStrain", "Axisymmetrical", "PlaneStrain", "GeneralisedPlaneStrain",
    "Tridimensional"};
const unsigned short labkit_nGradients = 1;
const int labkit_GradientsTypes[] = {1}; /* 0 scalar, 1 symmetric tensor */
const char *labkit_Gradients[] = {"Strain"};
const unsigned short labkit_nThermodynamicForces = 1;
const int labkit_ThermodynamicForcesTypes[] = {1};
const char *labkit_ThermodynamicForces[] = {"Stress"};
const unsigned short labkit_nTangentOperatorBlocks = 2;
const char *labkit_TangentOperatorBlocks[] = {"Stress", "Strain"};
const unsigned short labkit_nMaterialProperties = PROPERTIES;
const char *labkit_MaterialProperties[] = {
    "E", "e_cmax", "c_cZ", "gamma_cZ", "c_cLam", "A_c", "F_c", "Ft_c", "c_eA", "gamma_eA", "beta_dA", "gamma_A", "c_eZ",
    "beta_eZ", "c_Z", "c_com", "c_vZ", "beta_vZ", "gamma_F", "gamma_eLam", "c_eLam", "c_vLamd", "c_M", "strain_rate",
    "force_rate", "compression", "beyond_e_cmax", "tolerance", "initial_void_ratio", "initial_pressure",
    "A_b", "A_w", "F_b", "F_w", "Ft_b", "Ft_w", "d_e", "c_dLam", "distance",
    "reported", "parallel", "A_Z", "Ft_Z", "F_d", "Ft_d", "K_F",
    "Z_F", "F_0", "F_e", "A_0", "A_e"}; /* the last 21 are read if PROPERTIES is 51 */
const unsigned short labkit_nInternalStateVariables = 6;
const int labkit_InternalStateVariablesTypes[] = {0, 0, 0, 1, 1, 1};
const char *labkit_InternalStateVariables[] = {"e", "Z", "Lambda", "A", "F", "Ft"};
const unsigned short labkit_nExternalStateVariables = 0;
const int labkit_ExternalStateVariablesTypes[] = {0};
const char *labkit_ExternalStateVariables[] = {0};
const unsigned short labkit_nParameters = 0;
const int labkit_ParametersTypes[] = {0};
const char *labkit_Parameters[] = {0};
const unsigned short labkit_nInitializeFunctions = 0;
const unsigned short labkit_nPostProcessings = 0;
