!DIR$ FREEFORM
! labkit's constitutive model (He, Wu & Wang 2019, Eqs. C0 to C5, 31 and 32) as a material law for finite-element codes.
!
! Self-contained Fortran 2008. Entry points: UMAT and SDVINI with Abaqus's signatures, and for other programs the C
! functions labkit_update, labkit_initial_state and labkit_formulas. The equations are those of labkit/model; labkit's
! tests compare every formula, the updated state, the stress and the tangent with the Python functions of the same names.
!
! Conventions of UMAT: tension positive, order 11, 22, 33, 12, 13, 23, engineering shear strains.
! Conventions inside: compression positive, Mandel notation (xx, yy, zz, sqrt2 yz, sqrt2 xz, sqrt2 xy).
!
! PROPS   1      E, Young's modulus of the grains, in the unit of stress of the analysis
!         2-23   Table 2 in the order of labkit.model.parameters.Parameters
!         24-27  readings, 0 or 1: total strain rate, force rate with |Lambda|, Eq. 31 as printed, flat beyond e_cmax
!         28     tolerance of a substep; 0 selects 1e-4
!         29     initial void ratio of points without a state
!         30     initial isotropic pressure of points without a state and without stress
!         31-37  dependence on the Lode angle in the order of labkit.model.parameters.LodeDependence; 0 is the paper's
! STATEV  1-3    e, Z, Lambda
!         4-9    A, 10-15 F, 16-21 F^t: components 11, 22, 33, 12, 13, 23 of the tensor, compression positive
! PROPS 24 to 37 may be left out, from the end.

module labkit_model
  use, intrinsic :: iso_c_binding, only: c_double, c_int
  use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
  implicit none
  private
  public :: constants, constants_of, update_point, initial_state, stress_of, write_formulas
  public :: wp, n_state, n_table, n_props, fine, not_finite, no_start, wrong_input, reason_of

  integer, parameter :: wp = c_double
  integer, parameter :: n_state = 21, n_table = 23, n_props = 37
  real(wp), parameter :: root2 = sqrt(2.0_wp)
  real(wp), parameter :: identity(6) = [1.0_wp, 1.0_wp, 1.0_wp, 0.0_wp, 0.0_wp, 0.0_wp]
  real(wp), parameter :: isotropic_below = 1.0e-10_wp
  integer, parameter :: most_substeps = 100000
  real(wp), parameter :: smallest = 1.0e-13_wp  ! substep at which a boundary counts as reached

  ! Status of an update: the numbers of labkit.model.rates, and those of this file from 9 on.
  integer, parameter :: fine = 0, not_finite = 1, no_force = 2, no_contacts = 3, too_loose = 4, no_voids = 5
  integer, parameter :: too_many_steps = 7, no_start = 9, wrong_input = 10

  type :: constants
    real(wp) :: E, e_cmax, c_cZ, gamma_cZ, c_cLam, A_c, F_c, Ft_c
    real(wp) :: c_eA, gamma_eA, beta_dA, gamma_A, c_eZ, beta_eZ, c_Z, c_com, c_vZ, beta_vZ
    real(wp) :: gamma_F, gamma_eLam, c_eLam, c_vLamd, c_M
    logical :: total_rate, with_force, as_printed, flat
    real(wp) :: tolerance, initial_void_ratio, initial_pressure
    real(wp) :: A_b, A_w, F_b, F_w, Ft_b, Ft_w, d_e
  end type constants

contains

  ! ---- parameters ---------------------------------------------------------------------------------------------------

  !> Constants from PROPS; status is wrong_input for fewer than 23 values, or values that are not finite or negative.
  pure subroutine constants_of(props, c, status)
    real(wp), intent(in) :: props(:)
    type(constants), intent(out) :: c
    integer, intent(out) :: status
    real(wp) :: p(n_props)
    integer, parameter :: positive(15) = [1, 2, 3, 4, 5, 6, 7, 8, 9, 13, 16, 17, 21, 22, 23]  ! the others may be zero
    integer :: n
    p = 0.0_wp
    n = min(size(props), n_props)
    p(:n) = props(:n)
    c%E = p(1); c%e_cmax = p(2); c%c_cZ = p(3); c%gamma_cZ = p(4); c%c_cLam = p(5)
    c%A_c = p(6); c%F_c = p(7); c%Ft_c = p(8)
    c%c_eA = p(9); c%gamma_eA = p(10); c%beta_dA = p(11); c%gamma_A = p(12); c%c_eZ = p(13); c%beta_eZ = p(14)
    c%c_Z = p(15); c%c_com = p(16); c%c_vZ = p(17); c%beta_vZ = p(18)
    c%gamma_F = p(19); c%gamma_eLam = p(20); c%c_eLam = p(21); c%c_vLamd = p(22); c%c_M = p(23)
    c%total_rate = p(24) > 0.5_wp; c%with_force = p(25) > 0.5_wp
    c%as_printed = p(26) > 0.5_wp; c%flat = p(27) > 0.5_wp
    c%tolerance = merge(p(28), 1.0e-4_wp, p(28) > 0.0_wp)
    c%initial_void_ratio = p(29); c%initial_pressure = p(30)
    c%A_b = p(31); c%A_w = p(32); c%F_b = p(33); c%F_w = p(34); c%Ft_b = p(35); c%Ft_w = p(36); c%d_e = p(37)
    status = fine
    if (n < n_table) status = wrong_input
    if (.not. all(ieee_is_finite(p)) .or. any(p(:30) < 0.0_wp) .or. .not. all(p(positive) > 0.0_wp)) status = wrong_input
  end subroutine constants_of

  !> A sentence for a status.
  pure function reason_of(status) result(text)
    integer, intent(in) :: status
    character(len=100) :: text
    select case (status)
    case (not_finite); text = "a strain increment or the state is not a finite number"
    case (no_force); text = "Lambda falls to zero: the contacts no longer carry force"
    case (no_contacts); text = "Z falls to zero: there are no contacts left"
    case (too_loose); text = "the void ratio reaches e_cmax: PROPS(27) = 1 continues with flat lines"
    case (no_voids); text = "the void ratio falls to zero"
    case (too_many_steps); text = "more than 100000 substeps"
    case (no_start); text = "no initial state: give STATEV, or PROPS(29) and a compressive STRESS or PROPS(30)"
    case (wrong_input); text = "PROPS needs 23 to 37 numbers, the first 30 positive, NSTATV 21, NDI 3, NTENS 4 or 6"
    case default; text = "fine"
    end select
  end function reason_of

  ! ---- tensors (labkit.model.tensors) -------------------------------------------------------------------------------

  pure real(wp) function norm(T)
    real(wp), intent(in) :: T(6)
    norm = sqrt(dot_product(T, T))
  end function norm

  pure real(wp) function trace(T)
    real(wp), intent(in) :: T(6)
    trace = T(1) + T(2) + T(3)
  end function trace

  pure function deviator(T) result(s)
    real(wp), intent(in) :: T(6)
    real(wp) :: s(6)
    s = T
    s(1:3) = T(1:3) - trace(T) / 3.0_wp
  end function deviator

  !> (ST + TS)/2
  pure function symmetric_product(S, T) result(P)
    real(wp), intent(in) :: S(6), T(6)
    real(wp) :: P(6)
    P(1) = S(1) * T(1) + 0.5_wp * (S(6) * T(6) + S(5) * T(5))
    P(2) = S(2) * T(2) + 0.5_wp * (S(6) * T(6) + S(4) * T(4))
    P(3) = S(3) * T(3) + 0.5_wp * (S(5) * T(5) + S(4) * T(4))
    P(4) = (S(6) * T(5) + T(6) * S(5)) / (2.0_wp * root2) &
         + 0.5_wp * (S(2) * T(4) + T(2) * S(4) + S(4) * T(3) + T(4) * S(3))
    P(5) = (S(6) * T(4) + T(6) * S(4)) / (2.0_wp * root2) &
         + 0.5_wp * (S(1) * T(5) + T(1) * S(5) + S(5) * T(3) + T(5) * S(3))
    P(6) = (S(5) * T(4) + T(5) * S(4)) / (2.0_wp * root2) &
         + 0.5_wp * (S(1) * T(6) + T(1) * S(6) + S(6) * T(2) + T(6) * S(2))
  end function symmetric_product

  ! ---- equations (labkit.model.equations) ---------------------------------------------------------------------------

  !> e_cmax - e, zero beyond e_cmax
  pure real(wp) function density_distance(e, c)
    real(wp), intent(in) :: e
    type(constants), intent(in) :: c
    density_distance = max(c%e_cmax - e, 0.0_wp)
  end function density_distance

  !> Z^c = 4 + c_cZ (e_cmax - e)^gamma_cZ
  pure real(wp) function critical_coordination_number(e, c)
    real(wp), intent(in) :: e
    type(constants), intent(in) :: c
    critical_coordination_number = 4.0_wp + c%c_cZ * density_distance(e, c)**c%gamma_cZ
  end function critical_coordination_number

  !> Lambda^c = c_cLambda (e_cmax - e)
  pure real(wp) function critical_force(e, c)
    real(wp), intent(in) :: e
    type(constants), intent(in) :: c
    critical_force = c%c_cLam * density_distance(e, c)
  end function critical_force

  !> Z^com = 4 + c_com (e_cmax - e)^gamma_cZ
  pure real(wp) function compression_coordination_number(e, c)
    real(wp), intent(in) :: e
    type(constants), intent(in) :: c
    compression_coordination_number = 4.0_wp + c%c_com * density_distance(e, c)**c%gamma_cZ
  end function compression_coordination_number

  !> dZ^com/de, zero beyond e_cmax
  pure real(wp) function compression_slope(e, c)
    real(wp), intent(in) :: e
    type(constants), intent(in) :: c
    real(wp) :: distance
    distance = density_distance(e, c)
    compression_slope = 0.0_wp
    if (distance > 0.0_wp) compression_slope = -c%c_com * c%gamma_cZ * distance**(c%gamma_cZ - 1.0_wp)
  end function compression_slope

  !> f^{d,A} = f^{d,F} = exp(beta_dA [Lambda^c - Lambda])
  pure real(wp) function f_dA(e, Lam, c)
    real(wp), intent(in) :: e, Lam
    type(constants), intent(in) :: c
    f_dA = exp(c%beta_dA * (critical_force(e, c) - Lam))
  end function f_dA

  !> f^{e,A} = c_eA/Lambda^gamma_eA
  pure real(wp) function f_eA(Lam, c)
    real(wp), intent(in) :: Lam
    type(constants), intent(in) :: c
    f_eA = c%c_eA / Lam**c%gamma_eA
  end function f_eA

  !> f^{e,F} = [|F^c|/|A^c|] f^{e,A}
  pure real(wp) function f_eF(Lam, c)
    real(wp), intent(in) :: Lam
    type(constants), intent(in) :: c
    f_eF = c%F_c / c%A_c * f_eA(Lam, c)
  end function f_eF

  !> f^{e,Z} = c_eZ exp(beta_eZ [Lambda^c - Lambda])
  pure real(wp) function f_eZ(e, Lam, c)
    real(wp), intent(in) :: e, Lam
    type(constants), intent(in) :: c
    f_eZ = c%c_eZ * exp(c%beta_eZ * (critical_force(e, c) - Lam))
  end function f_eZ

  !> f^{e,L} = c_eL Lambda^gamma_eL f^{e,Z}
  pure real(wp) function f_eLam(e, Lam, c)
    real(wp), intent(in) :: e, Lam
    type(constants), intent(in) :: c
    f_eLam = c%c_eLam * Lam**c%gamma_eLam * f_eZ(e, Lam, c)
  end function f_eLam

  !> f^{v,Z} of Eq. 31
  pure real(wp) function f_vZ(e, Z, Lam, compressing, c)
    real(wp), intent(in) :: e, Z, Lam
    logical, intent(in) :: compressing
    type(constants), intent(in) :: c
    if (compressing) then
      f_vZ = exp(c%beta_vZ * (compression_coordination_number(e, c) - Z)) * compression_slope(e, c) * (1.0_wp + e)
      if (.not. c%as_printed) f_vZ = -f_vZ
    else
      f_vZ = c%c_vZ / Lam
    end if
  end function f_vZ

  !> f^{v,L} of Eq. 32
  pure real(wp) function f_vLam(e, compressing, c)
    real(wp), intent(in) :: e
    logical, intent(in) :: compressing
    type(constants), intent(in) :: c
    f_vLam = merge(c%c_cLam, c%c_vLamd, compressing) * (1.0_wp + e)
  end function f_vLam

  !> N = sqrt(6) dev(n n), with N:n = cos(3 theta)
  pure function lode_direction(n) result(R)
    real(wp), intent(in) :: n(6)
    real(wp) :: R(6)
    R = sqrt(6.0_wp) * deviator(symmetric_product(n, n))
  end function lode_direction

  !> T^c/T_c
  pure function attractor(n, b, w) result(R)
    real(wp), intent(in) :: n(6), b, w
    real(wp) :: R(6)
    R = lode_direction(n)
    R = (1.0_wp - b - w * dot_product(R, n)) * n + (b + w) * R
  end function attractor

  !> d(T^c/T_c) for dn and d(cos 3 theta), with N = lode_direction(n)
  pure function attractor_differential(n, N3, dn, dcos, b, w) result(R)
    real(wp), intent(in) :: n(6), N3(6), dn(6), dcos, b, w
    real(wp) :: R(6)
    R = (1.0_wp - b - w * dot_product(N3, n)) * dn - w * dcos * n &
      + (b + w) * 2.0_wp * sqrt(6.0_wp) * deviator(symmetric_product(n, dn))
  end function attractor_differential

  !> Void ratio of the lines: it falls with the Lode angle of n, as if e_cmax grew
  pure real(wp) function line_void_ratio(e, n, c)
    real(wp), intent(in) :: e, n(6)
    type(constants), intent(in) :: c
    line_void_ratio = e - 0.25_wp * c%d_e * (dot_product(n, n) - dot_product(lode_direction(n), n))**2
  end function line_void_ratio

  !> f |T^c - T|^gamma (T^c - T), the right-hand side of C1 and C3
  pure function relaxation(stiffness, exponent, target, T) result(R)
    real(wp), intent(in) :: stiffness, exponent, target(6), T(6)
    real(wp) :: R(6)
    R = target - T
    R = stiffness * norm(R)**exponent * R
  end function relaxation

  !> C1
  pure function contact_anisotropy_rate(A, e, Lam, n, rate, c) result(R)
    real(wp), intent(in) :: A(6), e, Lam, n(6), rate
    type(constants), intent(in) :: c
    real(wp) :: R(6)
    R = rate * relaxation(f_eA(Lam, c), c%gamma_A, f_dA(e, Lam, c) * c%A_c * attractor(n, c%A_b, c%A_w), A)
  end function contact_anisotropy_rate

  !> C2
  pure real(wp) function coordination_number_rate(Z, e, Lam, A_rate, rate, volumetric, compressing, c)
    real(wp), intent(in) :: Z, e, Lam, A_rate(6), rate, volumetric
    logical, intent(in) :: compressing
    type(constants), intent(in) :: c
    real(wp) :: shear
    shear = critical_coordination_number(e, c) - Z
    coordination_number_rate = f_eZ(e, Lam, c) * (shear * rate - c%c_Z * norm(A_rate)) &
                             + f_vZ(e, Z, Lam, compressing, c) * volumetric
  end function coordination_number_rate

  !> C3
  pure function normal_force_anisotropy_rate(F, e, Lam, n, rate, c) result(R)
    real(wp), intent(in) :: F(6), e, Lam, n(6), rate
    type(constants), intent(in) :: c
    real(wp) :: R(6)
    R = rate * relaxation(f_eF(Lam, c), c%gamma_F, f_dA(e, Lam, c) * c%F_c * attractor(n, c%F_b, c%F_w), F)
  end function normal_force_anisotropy_rate

  !> C4
  pure real(wp) function mean_force_rate(e, Lam, rate, volumetric, compressing, c)
    real(wp), intent(in) :: e, Lam, rate, volumetric
    logical, intent(in) :: compressing
    type(constants), intent(in) :: c
    real(wp) :: factor
    factor = merge(Lam, 1.0_wp, c%with_force)
    mean_force_rate = f_eLam(e, Lam, c) * factor * (critical_force(e, c) - Lam) * rate &
                    + f_vLam(e, compressing, c) * volumetric
  end function mean_force_rate

  !> C5
  pure function mobilisation_rate(Ft, n, rate, c) result(R)
    real(wp), intent(in) :: Ft(6), n(6), rate
    type(constants), intent(in) :: c
    real(wp) :: R(6)
    R = c%c_M * rate * (c%Ft_c * attractor(n, c%Ft_b, c%Ft_w) - Ft)
  end function mobilisation_rate

  !> The bracket of C0
  pure function bracket(A, F, Ft) result(B)
    real(wp), intent(in) :: A(6), F(6), Ft(6)
    real(wp) :: B(6)
    B = identity / 3.0_wp + 2.0_wp / 15.0_wp * A + 2.0_wp / 15.0_wp * F &
      + 2.0_wp / 105.0_wp * dot_product(F, A) * identity + 8.0_wp / 105.0_wp * symmetric_product(F, A) + Ft
  end function bracket

  !> C0 at the state y
  pure function stress_of(y, c) result(sigma)
    real(wp), intent(in) :: y(n_state)
    type(constants), intent(in) :: c
    real(wp) :: sigma(6)
    sigma = c%E * y(2) * y(3) / (1.0_wp + y(1)) * bracket(y(4:9), y(10:15), y(16:21))
  end function stress_of

  !> Total differential of C0 at y in the direction v: Eq. 33 with the coupled terms of A and F
  pure function stress_rate_of(y, v, c) result(rate)
    real(wp), intent(in) :: y(n_state), v(n_state)
    type(constants), intent(in) :: c
    real(wp) :: rate(6), factor, factor_rate, bracket_rate(6)
    factor = c%E * y(2) * y(3) / (1.0_wp + y(1))
    factor_rate = c%E * (v(2) * y(3) + y(2) * v(3)) / (1.0_wp + y(1)) - factor * v(1) / (1.0_wp + y(1))
    bracket_rate = 2.0_wp / 105.0_wp * (dot_product(v(10:15), y(4:9)) + dot_product(y(10:15), v(4:9))) * identity &
                 + 2.0_wp / 15.0_wp * (v(4:9) + v(10:15)) + v(16:21) &
                 + 8.0_wp / 105.0_wp * (symmetric_product(v(10:15), y(4:9)) + symmetric_product(y(10:15), v(4:9)))
    rate = factor_rate * bracket(y(4:9), y(10:15), y(16:21)) + factor * bracket_rate
  end function stress_rate_of

  !> Direction n of the deviatoric strain rate, |rate| and the volumetric rate
  pure subroutine split_rate(D, c, n, rate, volumetric)
    real(wp), intent(in) :: D(6)
    type(constants), intent(in) :: c
    real(wp), intent(out) :: n(6), rate, volumetric
    real(wp) :: length
    n = deviator(D)
    length = norm(n)
    if (length > 0.0_wp) n = n / length
    rate = length
    if (c%total_rate) rate = norm(D)
    volumetric = trace(D)
  end subroutine split_rate

  ! ---- rates (labkit.model.rates) -----------------------------------------------------------------------------------

  !> fine, or the reason why the equations are undefined at y
  pure integer function outside(y, c)
    real(wp), intent(in) :: y(n_state)
    type(constants), intent(in) :: c
    outside = fine
    if (.not. all(ieee_is_finite(y))) then
      outside = not_finite
    else if (y(3) <= 0.0_wp) then
      outside = no_force
    else if (y(2) <= 0.0_wp) then
      outside = no_contacts
    else if (y(1) <= 0.0_wp) then
      outside = no_voids
    else if (y(1) >= c%e_cmax .and. .not. c%flat) then
      outside = too_loose
    end if
  end function outside

  !> dy/dt for the strain rate D, C1 to C5
  pure function strain_driven(y, D, compressing, c) result(v)
    real(wp), intent(in) :: y(n_state), D(6)
    logical, intent(in) :: compressing
    type(constants), intent(in) :: c
    real(wp) :: v(n_state), n(6), rate, volumetric, e
    call split_rate(D, c, n, rate, volumetric)
    e = line_void_ratio(y(1), n, c)
    v(4:9) = contact_anisotropy_rate(y(4:9), e, y(3), n, rate, c)
    v(1) = -(1.0_wp + y(1)) * volumetric
    v(2) = coordination_number_rate(y(2), e, y(3), v(4:9), rate, volumetric, compressing, c)
    v(3) = mean_force_rate(e, y(3), rate, volumetric, compressing, c)
    v(10:15) = normal_force_anisotropy_rate(y(10:15), e, y(3), n, rate, c)
    v(16:21) = mobilisation_rate(y(16:21), n, rate, c)
  end function strain_driven

  ! ---- differentials (labkit.model.differentials) -------------------------------------------------------------------

  !> d(g rate X) of C1 and C3, with g = f^e |X|^gamma; loss: -d(ln f^e)
  pure function relaxation_differential(X, dX, length, g, gamma, loss, rate, drate) result(R)
    real(wp), intent(in) :: X(6), dX(6), length, g, gamma, loss, rate, drate
    real(wp) :: R(6), dg, along
    along = 0.0_wp
    if (length > 0.0_wp) along = dot_product(X, dX) / (length * length)
    dg = g * (gamma * along - loss)
    R = (dg * rate + g * drate) * X + g * rate * dX
  end function relaxation_differential

  !> d(dy/dt) for the six unit increments of D, each with the change S(:, k) of the state: columns of out
  pure subroutine rates_differentials(y, D, compressing, c, S, out)
    real(wp), intent(in) :: y(n_state), D(6), S(n_state, 6)
    logical, intent(in) :: compressing
    type(constants), intent(in) :: c
    real(wp), intent(out) :: out(n_state, 6)
    real(wp) :: e, Z, Lam, n(6), rate, volumetric, length, distance, Zc, Lamc, slope, curvature, Zc_slope, Lamc_slope
    real(wp) :: fd, feA, feF, feZ, feLam, fvZ, fvLam, XA(6), XF(6), mA, mF, gA, gF, A_rate(6), A_size, force, missing(6)
    real(wp) :: dDk(6), dev(6), dvol, along, dn(6), drate, dLamc, dZc, dfd, dfeZ, dX(6), dA_rate(6), loss, dfvZ, dfvLam
    real(wp) :: dA_size, dfeLam, dforce, forward(n_state), backward(n_state), N3(6), nA(6), nF(6), nFt(6), dcos, de
    logical :: isotropic, below
    integer :: k
    Z = y(2); Lam = y(3)
    call split_rate(D, c, n, rate, volumetric)
    length = norm(deviator(D))
    isotropic = length <= isotropic_below * norm(D)
    if (isotropic) then
      n = 0.0_wp
      if (.not. c%total_rate) rate = 0.0_wp
    end if
    N3 = lode_direction(n)
    e = line_void_ratio(y(1), n, c)
    nA = attractor(n, c%A_b, c%A_w); nF = attractor(n, c%F_b, c%F_w); nFt = attractor(n, c%Ft_b, c%Ft_w)
    distance = density_distance(e, c)
    below = distance > 0.0_wp
    Zc = critical_coordination_number(e, c); Lamc = critical_force(e, c); slope = compression_slope(e, c)
    curvature = 0.0_wp; Zc_slope = 0.0_wp; Lamc_slope = 0.0_wp
    if (below) then
      curvature = c%c_com * c%gamma_cZ * (c%gamma_cZ - 1.0_wp) * distance**(c%gamma_cZ - 2.0_wp)
      Zc_slope = -c%c_cZ * c%gamma_cZ * distance**(c%gamma_cZ - 1.0_wp)
      Lamc_slope = -c%c_cLam
    end if
    fd = f_dA(e, Lam, c); feA = f_eA(Lam, c); feF = f_eF(Lam, c); feZ = f_eZ(e, Lam, c)
    feLam = f_eLam(e, Lam, c); fvZ = f_vZ(e, Z, Lam, compressing, c); fvLam = f_vLam(e, compressing, c)
    XA = fd * c%A_c * nA - y(4:9); XF = fd * c%F_c * nF - y(10:15)
    mA = norm(XA); mF = norm(XF)
    gA = feA * mA**c%gamma_A; gF = feF * mF**c%gamma_F
    A_rate = gA * rate * XA
    A_size = norm(A_rate)
    force = merge(Lam, 1.0_wp, c%with_force)
    do k = 1, 6
      dDk = 0.0_wp
      dDk(k) = 1.0_wp
      dev = deviator(dDk); dvol = trace(dDk)
      along = 0.0_wp; dn = 0.0_wp
      if (.not. isotropic) then
        along = dot_product(n, dev)
        dn = (dev - along * n) / length
      end if
      drate = along
      if (c%total_rate) then
        drate = 0.0_wp
        if (norm(D) > 0.0_wp) drate = dot_product(D, dDk) / norm(D)
      end if
      dcos = 3.0_wp * dot_product(N3, dn)
      de = S(1, k) + 0.5_wp * c%d_e * (dot_product(n, n) - dot_product(N3, n)) * dcos
      dLamc = Lamc_slope * de; dZc = Zc_slope * de
      dfd = c%beta_dA * fd * (dLamc - S(3, k))
      dfeZ = c%beta_eZ * feZ * (dLamc - S(3, k))
      loss = c%gamma_eA * S(3, k) / Lam
      ! C1
      dX = c%A_c * (dfd * nA + fd * attractor_differential(n, N3, dn, dcos, c%A_b, c%A_w)) - S(4:9, k)
      dA_rate = relaxation_differential(XA, dX, mA, gA, c%gamma_A, loss, rate, drate)
      ! C3
      dX = c%F_c * (dfd * nF + fd * attractor_differential(n, N3, dn, dcos, c%F_b, c%F_w)) - S(10:15, k)
      out(10:15, k) = relaxation_differential(XF, dX, mF, gF, c%gamma_F, loss, rate, drate)
      ! C5
      missing = c%Ft_c * nFt - y(16:21)
      dX = c%Ft_c * attractor_differential(n, N3, dn, dcos, c%Ft_b, c%Ft_w) - S(16:21, k)
      out(16:21, k) = c%c_M * (drate * missing + rate * dX)
      ! 31, 32
      if (.not. compressing) then
        dfvZ = -fvZ / Lam * S(3, k)
      else if (below) then
        dfvZ = fvZ * (c%beta_vZ * (slope * de - S(2, k)) + curvature / slope * de + de / (1.0_wp + e))
      else
        dfvZ = 0.0_wp
      end if
      dfvLam = fvLam / (1.0_wp + e) * de
      ! C2
      dA_size = 0.0_wp
      if (A_size > 0.0_wp) dA_size = dot_product(A_rate, dA_rate) / A_size
      out(2, k) = dfeZ * ((Zc - Z) * rate - c%c_Z * A_size) &
                + feZ * ((dZc - S(2, k)) * rate + (Zc - Z) * drate - c%c_Z * dA_size) + dfvZ * volumetric + fvZ * dvol
      ! C4
      dfeLam = feLam * (c%gamma_eLam * S(3, k) / Lam + dfeZ / feZ)
      dforce = merge(S(3, k), 0.0_wp, c%with_force)
      out(3, k) = (dfeLam * force + feLam * dforce) * (Lamc - Lam) * rate &
                + feLam * force * ((dLamc - S(3, k)) * rate + (Lamc - Lam) * drate) + dfvLam * volumetric + fvLam * dvol
      out(1, k) = -(1.0_wp + y(1)) * dvol - S(1, k) * volumetric
      out(4:9, k) = dA_rate
      if (isotropic .and. .not. c%total_rate) then  ! the mean of the two one-sided derivatives of |rate|
        forward = strain_driven(y, dev, compressing, c)
        backward = strain_driven(y, -dev, compressing, c)
        out(2:, k) = out(2:, k) + 0.5_wp * (forward(2:) - backward(2:))
      end if
    end do
  end subroutine rates_differentials

  ! ---- update (labkit.model.material_point) -------------------------------------------------------------------------

  !> Heun's method with error control over the increment D. y changes only if status is fine; otherwise sigma is the
  !> stress before the increment, and the tangent that of the rates, so that both are finite.
  pure subroutine update_point(y, D, c, with_tangent, sigma, tangent, status, substeps)
    real(wp), intent(inout) :: y(n_state)
    real(wp), intent(in) :: D(6)
    type(constants), intent(in) :: c
    logical, intent(in) :: with_tangent
    real(wp), intent(out) :: sigma(6), tangent(6, 6)
    integer, intent(out) :: status, substeps
    real(wp) :: now(n_state), k1(n_state), k2(n_state), trial(n_state), new(n_state), floor(n_state)
    real(wp) :: S(n_state, 6), dk1(n_state, 6), dk2(n_state, 6), done, h, error
    logical :: compressing
    integer :: tries, k
    substeps = 0
    status = outside(y, c)
    if (status == fine .and. .not. all(ieee_is_finite(D))) status = not_finite
    if (status /= fine) then
      call stand_in(y, c, sigma, tangent)
      return
    end if
    floor = 0.1_wp
    floor(3) = 1.0e-4_wp
    now = y
    S = 0.0_wp
    compressing = trace(D) > 0.0_wp
    done = 0.0_wp; h = 1.0_wp; tries = 0; error = 0.0_wp
    do while (done < 1.0_wp)
      if (tries >= most_substeps) then
        if (status == fine) status = too_many_steps
        exit
      end if
      tries = tries + 1
      h = min(h, 1.0_wp - done)
      k1 = strain_driven(now, D, compressing, c)
      trial = now + h * k1
      status = outside(trial, c)
      if (status == fine) then
        k2 = strain_driven(trial, D, compressing, c)
        new = now + 0.5_wp * h * (k1 + k2)
        error = maxval(abs(0.5_wp * h * (k2 - k1)) / max(abs(new), floor))
        status = outside(new, c)
      end if
      if (status /= fine) then
        if (h < smallest) exit
        h = 0.25_wp * h
        cycle
      end if
      if (error > c%tolerance) then
        h = h * max(0.1_wp, 0.9_wp * sqrt(c%tolerance / error))
        cycle
      end if
      if (with_tangent) then
        call rates_differentials(now, D, compressing, c, S, dk1)
        call rates_differentials(trial, D, compressing, c, S + h * dk1, dk2)
        S = S + 0.5_wp * h * (dk1 + dk2)
      end if
      now = new
      done = done + h
      substeps = substeps + 1
      if (1.0_wp - done < 1.0e-14_wp) exit
      if (error > 0.0_wp) then
        h = h * min(5.0_wp, max(0.1_wp, 0.9_wp * sqrt(c%tolerance / error)))
      else
        h = 5.0_wp * h
      end if
    end do
    if (status /= fine) then
      call stand_in(y, c, sigma, tangent)
      return
    end if
    y = now
    sigma = stress_of(y, c)
    if (with_tangent) then
      do k = 1, 6
        tangent(:, k) = stress_rate_of(y, S(:, k), c)
      end do
    else
      tangent = 0.0_wp
    end if
  end subroutine update_point

  !> Finite stress and tangent of a point whose increment failed: the calling program repeats the increment in parts
  pure subroutine stand_in(y, c, sigma, tangent)
    real(wp), intent(in) :: y(n_state)
    type(constants), intent(in) :: c
    real(wp), intent(out) :: sigma(6), tangent(6, 6)
    real(wp) :: zero(n_state, 6), S(n_state, 6)
    integer :: k
    sigma = 0.0_wp
    tangent = 0.0_wp
    do k = 1, 6
      tangent(k, k) = 1.0e-3_wp * c%E
    end do
    if (outside(y, c) /= fine) return
    sigma = stress_of(y, c)
    zero = 0.0_wp
    call rates_differentials(y, zero(1:6, 1), .false., c, zero, S)
    do k = 1, 6
      tangent(:, k) = stress_rate_of(y, S(:, k), c)
    end do
  end subroutine stand_in

  !> State with the stress sigma (compression positive): Z on the compression line, A = F^t = 0, F = 5/2 dev(sigma)/p
  pure subroutine initial_state(sigma, c, y, status)
    real(wp), intent(in) :: sigma(6)
    type(constants), intent(in) :: c
    real(wp), intent(out) :: y(n_state)
    integer, intent(out) :: status
    real(wp) :: p
    y = 0.0_wp
    status = no_start
    p = trace(sigma) / 3.0_wp
    if (.not. c%initial_void_ratio > 0.0_wp) return
    if (p > 0.0_wp) then
      y(10:15) = 2.5_wp * deviator(sigma) / p
    else
      p = c%initial_pressure
    end if
    if (.not. p > 0.0_wp) return
    y(1) = c%initial_void_ratio
    y(2) = compression_coordination_number(y(1), c)
    y(3) = 3.0_wp * p * (1.0_wp + y(1)) / (c%E * y(2))
    status = outside(y, c)
  end subroutine initial_state

  !> Every formula at one state, for the tests: see labkit/umat/library.py for the order
  pure subroutine write_formulas(y, D, compressing, c, out)
    real(wp), intent(in) :: y(n_state), D(6)
    logical, intent(in) :: compressing
    type(constants), intent(in) :: c
    real(wp), intent(out) :: out(78)
    real(wp) :: n(6), rate, volumetric, v(n_state)
    call split_rate(D, c, n, rate, volumetric)
    v = strain_driven(y, D, compressing, c)
    out(1) = density_distance(y(1), c)
    out(2) = critical_coordination_number(y(1), c)
    out(3) = critical_force(y(1), c)
    out(4) = compression_coordination_number(y(1), c)
    out(5) = compression_slope(y(1), c)
    out(6) = f_dA(y(1), y(3), c)
    out(7) = f_eA(y(3), c)
    out(8) = f_eF(y(3), c)
    out(9) = f_eZ(y(1), y(3), c)
    out(10) = f_eLam(y(1), y(3), c)
    out(11) = f_vZ(y(1), y(2), y(3), compressing, c)
    out(12) = f_vLam(y(1), compressing, c)
    out(13:18) = n
    out(19) = rate
    out(20) = volumetric
    out(21:26) = contact_anisotropy_rate(y(4:9), y(1), y(3), n, rate, c)
    out(27) = coordination_number_rate(y(2), y(1), y(3), out(21:26), rate, volumetric, compressing, c)
    out(28:33) = normal_force_anisotropy_rate(y(10:15), y(1), y(3), n, rate, c)
    out(34) = mean_force_rate(y(1), y(3), rate, volumetric, compressing, c)
    out(35:40) = mobilisation_rate(y(16:21), n, rate, c)
    out(41) = v(1)
    out(42:47) = symmetric_product(y(10:15), y(4:9))
    out(48:53) = bracket(y(4:9), y(10:15), y(16:21))
    out(54:59) = stress_of(y, c)
    out(60:65) = stress_rate_of(y, v, c)
    out(66:71) = relaxation(f_eA(y(3), c), c%gamma_A, n, y(4:9))
    out(72:77) = deviator(D)
    out(78) = real(outside(y, c), wp)
  end subroutine write_formulas
end module labkit_model

!> Abaqus's user material.
subroutine umat(stress, statev, ddsdde, sse, spd, scd, rpl, ddsddt, drplde, drpldt, stran, dstran, time, dtime, &
                temp, dtemp, predef, dpred, cmname, ndi, nshr, ntens, nstatv, props, nprops, coords, drot, pnewdt, &
                celent, dfgrd0, dfgrd1, noel, npt, layer, kspt, kstep, kinc)
  use labkit_model
  implicit none
  integer, intent(in) :: ndi, nshr, ntens, nstatv, nprops, noel, npt, layer, kspt, kstep, kinc
  real(wp), intent(inout) :: stress(ntens), statev(nstatv)
  real(wp), intent(inout) :: sse, spd, scd, rpl, ddsddt(*), drplde(*), drpldt
  real(wp), intent(inout), optional :: pnewdt  ! absent in programs that pass a null pointer, as Kratos does
  real(wp), intent(inout) :: ddsdde(ntens, ntens)
  real(wp), intent(in) :: stran(*), dstran(ntens), time(*), dtime, temp, dtemp, predef(*), dpred(*), props(nprops)
  real(wp), intent(in), optional :: drot(3, 3)
  real(wp), intent(in) :: coords(*), celent, dfgrd0(*), dfgrd1(*)
  character(len=*), intent(in) :: cmname
  integer, parameter :: place(6) = [1, 2, 3, 6, 5, 4]  ! of 11, 22, 33, 12, 13, 23 in the order of the module
  real(wp), parameter :: half = sqrt(0.5_wp), twice = sqrt(2.0_wp)
  real(wp), parameter :: weight(6) = [1.0_wp, 1.0_wp, 1.0_wp, twice, twice, twice]
  real(wp) :: y(n_state), sigma(6), strain(6), tangent(6, 6)
  type(constants) :: c
  integer :: status, substeps, i, k

  call constants_of(props, c, status)
  if (nstatv < n_state .or. ndi /= 3 .or. (ntens /= 4 .and. ntens /= 6)) status = wrong_input
  sigma = 0.0_wp
  strain = 0.0_wp
  do i = 1, ntens
    sigma(place(i)) = -stress(i) * merge(1.0_wp, twice, i <= 3)
    strain(place(i)) = -dstran(i) * merge(1.0_wp, half, i <= 3)
  end do
  if (status == fine) then
    if (statev(1) == 0.0_wp) then
      call initial_state(sigma, c, y, status)
    else
      call read_state()
    end if
  end if
  tangent = 0.0_wp
  if (status == fine) then
    call update_point(y, strain, c, .true., sigma, tangent, status, substeps)
  else
    do i = 1, 6
      tangent(i, i) = 1.0e-3_wp * max(c%E, 1.0_wp)
    end do
  end if
  do k = 1, ntens
    do i = 1, ntens
      ddsdde(i, k) = tangent(place(i), place(k)) / (weight(i) * weight(k))
    end do
  end do
  if (status /= fine) then
    if (present(pnewdt)) pnewdt = min(pnewdt, 0.25_wp)
    if (status >= no_start .or. .not. present(pnewdt)) then
      write (*, '(a,i0,a,i0,2a)') "labkit: element ", noel, ", point ", npt, ": ", trim(reason_of(status))
    end if
    return
  end if
  do i = 1, ntens
    stress(i) = -sigma(place(i)) / weight(i)
  end do
  call write_state()

contains

  !> STATEV to the order of the module, turned by DROT, the rotation of the increment in large deformations.
  subroutine read_state()
    integer :: t
    y(1:3) = statev(1:3)
    do t = 4, 16, 6
      y(t:t + 5) = turned(statev(t:t + 5))
    end do
  end subroutine read_state

  !> The tensor with components 11, 22, 33, 12, 13, 23, turned by DROT, in Mandel notation.
  function turned(v) result(six)
    real(wp), intent(in) :: v(6)
    real(wp) :: six(6), m(3, 3), identity(3, 3)
    logical :: turns
    m = reshape([v(1), v(4), v(5), v(4), v(2), v(6), v(5), v(6), v(3)], [3, 3])
    identity = reshape([1, 0, 0, 0, 1, 0, 0, 0, 1], [3, 3])
    turns = present(drot)
    if (turns) turns = any(drot /= identity) .and. all(abs(matmul(drot, transpose(drot)) - identity) < 1.0e-6_wp)
    if (turns) m = matmul(drot, matmul(m, transpose(drot)))
    six = [m(1, 1), m(2, 2), m(3, 3), twice * m(2, 3), twice * m(1, 3), twice * m(1, 2)]
  end function turned

  subroutine write_state()
    integer :: t
    statev(1:3) = y(1:3)
    do t = 4, 16, 6
      statev(t:t + 5) = [y(t), y(t + 1), y(t + 2), half * y(t + 5), half * y(t + 4), half * y(t + 3)]
    end do
  end subroutine write_state
end subroutine umat

!> Abaqus's initial state variables: zero, which UMAT replaces by a state for the initial stress and PROPS(29).
subroutine sdvini(statev, coords, nstatv, ncrds, noel, npt, layer, kspt)
  use labkit_model, only: wp
  implicit none
  integer, intent(in) :: nstatv, ncrds, noel, npt, layer, kspt
  real(wp), intent(out) :: statev(nstatv)
  real(wp), intent(in) :: coords(ncrds)
  statev = 0.0_wp
end subroutine sdvini

!> n increments, as labkit.model.material_point.update: C arrays state (n, 21), increment and stress (n, 6), tangent
!> (n, 6, 6), status and substeps (n). A failed point keeps its state; its stress and tangent are finite.
subroutine labkit_update(n, nprops, props, state, increment, with_tangent, stress, tangent, status, substeps) bind(c)
  use labkit_model
  use, intrinsic :: iso_c_binding, only: c_double, c_int
  implicit none
  integer(c_int), value :: n, nprops, with_tangent
  real(c_double), intent(in) :: props(nprops), increment(6, n)
  real(c_double), intent(inout) :: state(21, n)
  real(c_double), intent(out) :: stress(6, n)
  real(c_double), intent(inout) :: tangent(6, 6, *)
  integer(c_int), intent(out) :: status(n), substeps(n)
  real(wp) :: columns(6, 6)
  type(constants) :: c
  integer :: point, failed
  call constants_of(props, c, failed)
  status = failed
  substeps = 0
  stress = 0.0_wp
  if (failed /= fine) return
  do point = 1, n
    call update_point(state(:, point), increment(:, point), c, with_tangent /= 0, stress(:, point), columns, &
                      status(point), substeps(point))
    if (with_tangent /= 0) tangent(:, :, point) = transpose(columns)
  end do
end subroutine labkit_update

!> State (21) with the stress (6), compression positive; returns the status.
integer(c_int) function labkit_initial_state(nprops, props, stress, state) bind(c)
  use labkit_model
  use, intrinsic :: iso_c_binding, only: c_double, c_int
  implicit none
  integer(c_int), value :: nprops
  real(c_double), intent(in) :: props(nprops), stress(6)
  real(c_double), intent(out) :: state(21)
  type(constants) :: c
  integer :: status
  state = 0.0_wp
  call constants_of(props, c, status)
  if (status == fine) call initial_state(stress, c, state, status)
  labkit_initial_state = status
end function labkit_initial_state

!> Values of every formula at one state and strain rate, out (78).
subroutine labkit_formulas(nprops, props, state, rate, compressing, out) bind(c)
  use labkit_model
  use, intrinsic :: iso_c_binding, only: c_double, c_int
  implicit none
  integer(c_int), value :: nprops, compressing
  real(c_double), intent(in) :: props(nprops), state(21), rate(6)
  real(c_double), intent(out) :: out(78)
  type(constants) :: c
  integer :: status
  call constants_of(props, c, status)
  call write_formulas(state, rate, compressing /= 0, c, out)
end subroutine labkit_formulas
