!DIR$ FREEFORM
! labkit's constitutive model (He, Wu & Wang 2019, Eqs. C0 to C5, 31 and 32) as a material law for finite-element codes.
!
! Self-contained Fortran 2008. Entry points: UMAT and SDVINI with Abaqus's signatures, and for other programs the C
! functions labkit_update and labkit_initial_state. The equations are those of labkit/model, of which the functions
! strain_driven, stress_of and their differentials are a translation.
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
!         38     c_dLam, coefficient of the amendment to C4; 0 is the paper's
!         39-41  readings, 0 or 1: force rate with |Lambda^c - Lambda|, lines of the reported void ratio, Z parallel to
!                the compression line
!         42-45  dependence on density in the order of labkit.model.parameters.DensityDependence; 0 is the paper's
!         46-51  terms for reversals in the order of labkit.model.parameters.Reversals; 0 is the paper's
! STATEV  1-3    e, Z, Lambda
!         4-9    A, 10-15 F, 16-21 F^t: components 11, 22, 33, 12, 13, 23 of the tensor, compression positive
! PROPS 24 to 51 may be left out, from the end.

module labkit_model
  use, intrinsic :: iso_c_binding, only: c_double, c_int
  use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
  implicit none
  private
  public :: constants, constants_of, update_point, initial_state
  public :: wp, n_state, n_table, n_props, fine, not_finite, no_start, wrong_input, reason_of

  integer, parameter :: wp = c_double
  integer, parameter :: n_state = 21, n_table = 23, n_props = 51
  real(wp), parameter :: root2 = sqrt(2.0_wp)
  real(wp), parameter :: identity(6) = [1.0_wp, 1.0_wp, 1.0_wp, 0.0_wp, 0.0_wp, 0.0_wp]
  real(wp), parameter :: isotropic_below = 1.0e-10_wp
  integer, parameter :: most_substeps = 100000
  real(wp), parameter :: smallest = 1.0e-13_wp  ! substep at which a boundary is treated as reached

  ! Status of an update: the numbers of labkit.model.rates, and those of this file from 9 on.
  integer, parameter :: fine = 0, not_finite = 1, no_force = 2, no_contacts = 3, too_loose = 4, no_voids = 5
  integer, parameter :: too_many_steps = 7, no_start = 9, wrong_input = 10

  type :: constants
    real(wp) :: E, e_cmax, c_cZ, gamma_cZ, c_cLam, A_c, F_c, Ft_c
    real(wp) :: c_eA, gamma_eA, beta_dA, gamma_A, c_eZ, beta_eZ, c_Z, c_com, c_vZ, beta_vZ
    real(wp) :: gamma_F, gamma_eLam, c_eLam, c_vLamd, c_M
    logical :: total_rate, with_force, as_printed, flat
    real(wp) :: tolerance, initial_void_ratio, initial_pressure
    real(wp) :: A_b, A_w, F_b, F_w, Ft_b, Ft_w, d_e, c_dLam
    logical :: distance, reported, parallel
    real(wp) :: A_Z, Ft_Z, F_d, Ft_d, K_F, Z_F, F_0, F_e, A_0, A_e
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
    c%c_dLam = p(38); c%distance = p(39) > 0.5_wp; c%reported = p(40) > 0.5_wp; c%parallel = p(41) > 0.5_wp
    c%A_Z = p(42); c%Ft_Z = p(43); c%F_d = p(44); c%Ft_d = p(45)
    c%K_F = p(46); c%Z_F = p(47); c%F_0 = p(48); c%F_e = p(49); c%A_0 = p(50); c%A_e = p(51)
    status = fine
    if (n < n_table) status = wrong_input
    if (.not. all(ieee_is_finite(p)) .or. .not. all(p(positive) > 0.0_wp)) status = wrong_input
    if (any(p(:30) < 0.0_wp) .or. p(38) < 0.0_wp .or. any(p(46:47) < 0.0_wp)) status = wrong_input
  end subroutine constants_of

  !> The sentence that describes a status.
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
    case (wrong_input); text = "PROPS needs 23 to 51 numbers, the first 30 positive, NSTATV 21, NDI 3, NTENS 4 or 6"
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

  ! ---- equations, written by labkit.plugins.umat.fortran from labkit.model.equations -------------------------------------------

!EQUATIONS
  !> d(dy/dt) for the six unit increments of D, each with the change S(:, k) of the state: columns of out
  pure subroutine rates_differentials(y, D, compressing, c, S, out)
    real(wp), intent(in) :: y(n_state), D(6), S(n_state, 6)
    logical, intent(in) :: compressing
    type(constants), intent(in) :: c
    real(wp), intent(out) :: out(n_state, 6)
    real(wp) :: dev(6), forward(n_state), backward(n_state)
    integer :: k
    call differentials(y, D, compressing, c, S, out)
    if (c%total_rate .or. norm(deviator(D)) > isotropic_below * norm(D)) return
    do k = 1, 6  ! |rate| is not differentiable: the mean of the two one-sided derivatives
      dev = 0.0_wp
      dev(k) = 1.0_wp
      dev = deviator(dev)
      forward = strain_driven(y, dev, compressing, c)
      backward = strain_driven(y, -dev, compressing, c)
      out(2:, k) = out(2:, k) + 0.5_wp * (forward(2:) - backward(2:))
    end do
  end subroutine rates_differentials

  ! ---- update (labkit.plugins.umat.material_point) -------------------------------------------------------------------------

  !> Apply the increment D by Heun's method with error control. y changes only if status is fine; otherwise sigma is the
  !> stress before the increment, and the tangent follows from the rates, so that both are finite.
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

  !> Find a state with the stress sigma (compression positive): Z on the compression line, A = F^t = 0,
  !> F = 5/2 dev(sigma)/p
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
    y(2) = z_compression(y(1), c)
    y(3) = 3.0_wp * p * (1.0_wp + y(1)) / (c%E * y(2))
    status = outside(y, c)
  end subroutine initial_state
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
  integer, parameter :: place(6) = [1, 2, 3, 6, 5, 4]  ! index of 11, 22, 33, 12, 13, 23 in the order of the module
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

  !> Convert STATEV to the order of the module, rotated by DROT, the rotation of the increment in large deformations.
  subroutine read_state()
    integer :: t
    y(1:3) = statev(1:3)
    do t = 4, 16, 6
      y(t:t + 5) = turned(statev(t:t + 5))
    end do
  end subroutine read_state

  !> Rotate a tensor with components 11, 22, 33, 12, 13, 23 by DROT and convert it to Mandel notation.
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

!> Apply n increments like labkit.plugins.umat.material_point.update. C arrays: state (n, 21), increment and stress (n, 6),
!> tangent (n, 6, 6), status and substeps (n). A failed point keeps its state; its stress and tangent are finite.
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

!> Find the state (21) with the stress (6), compression positive; returns the status.
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
