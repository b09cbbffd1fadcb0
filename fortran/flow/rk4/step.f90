!> The step formula: classical fourth-order Runge-Kutta with step doubling, its error estimate and
!> its dense output.
!>
!> A step of length h is two classical steps of h/2. A single classical step of h beside them tells
!> their error, (fine - coarse)/15, to leading order whatever the system (Richardson; Hairer,
!> Norsett and Wanner, Solving Ordinary Differential Equations I, section II.4). The error is
!> added to the result, which then is of fifth order; the tolerance is held by the error before
!> that. Figures against other fourth-order formulas: docs/method.md.
!>
!> A system may do the same stages itself: the gear's oscillator does, in system/spring_stages.f90,
!> multiplied out, and what is changed here has to be changed there.
module lapwing_flow_rk4_step
  use lapwing_kinds, only: wp
  use lapwing_flow_rk4_step_control, only: error_ratio
  use lapwing_system, only: system_t, frame_t, motion_t
  use lapwing_system_step, only: step_t, kept_t, max_states, change, richardson
  implicit none
  private
  public :: ratio_in_contact, rk4_step, rk4_move, read_step

  !> An estimate below the rounding of its own sum says nothing: in a flight, where the formula is
  !> exact, it would otherwise shorten the steps.
  real(wp), parameter :: rounding = 16*epsilon(1.0_wp)

contains

  !> One classical step: four rates, and the change they make together.
  subroutine classical_step(system, frame, motion_state, s, h, z, k1, z_end)
    class(system_t), intent(in) :: system         !! what moves
    type(frame_t), intent(in) :: frame            !! frame as opened
    integer, intent(in) :: motion_state
    real(wp), intent(in) :: s                     !! where it begins
    real(wp), intent(in) :: h                     !! its length
    real(wp), intent(in) :: z(:)                  !! local coordinates at s
    real(wp), intent(in) :: k1(:)                 !! their rates there
    real(wp), intent(out) :: z_end(:)             !! local coordinates at s + h
    real(wp), dimension(size(z)) :: k2, k3, k4
    real(wp) :: half
    half = 0.5_wp*h
    call system%derivatives(frame, motion_state, s + half, z + half*k1, k2)
    call system%derivatives(frame, motion_state, s + half, z + half*k2, k3)
    call system%derivatives(frame, motion_state, s + h, z + h*k3, k4)
    z_end = z + change(h, k1, k2, k3, k4)
  end subroutine classical_step

  !> Two steps of half the length and one beside them, extrapolated.
  subroutine doubled_step(system, frame, motion_state, h, z, dense, step)
    class(system_t), intent(in) :: system         !! what moves
    type(frame_t), intent(in) :: frame            !! frame as opened
    integer, intent(in) :: motion_state
    real(wp), intent(in) :: h                     !! length of both together
    real(wp), intent(in) :: z(max_states)         !! local coordinates at s = 0
    logical, intent(in) :: dense                  !! whether the rate at the end is wanted
    type(step_t), intent(inout) :: step           !! the result
    real(wp), dimension(system%n_states) :: middle, fine, coarse
    real(wp) :: half
    half = 0.5_wp*h
    associate (n => system%n_states)
      associate (z0 => z(:n), k1 => step%rate_begin(:n), k_middle => step%rate_middle(:n))
        call system%derivatives(frame, motion_state, 0.0_wp, z0, k1)
        call classical_step(system, frame, motion_state, 0.0_wp, half, z0, k1, middle)
        call system%derivatives(frame, motion_state, half, middle, k_middle)
        call classical_step(system, frame, motion_state, half, half, middle, k_middle, fine)
        call classical_step(system, frame, motion_state, 0.0_wp, h, z0, k1, coarse)
      end associate
      step%correction(:n) = richardson*(fine - coarse)
      step%middle(:n) = middle + 0.5_wp*step%correction(:n)
      step%end(:n) = fine + step%correction(:n)
      if (dense) call system%derivatives(frame, motion_state, h, step%end(:n), step%rate_end(:n))
    end associate
  end subroutine doubled_step

  !> One step of length h with dense output and error estimate.
  subroutine rk4_step(system, frame, motion_state, h, z, motion, z_end, error)
    class(system_t), intent(in) :: system         !! what moves
    type(frame_t), intent(in) :: frame            !! frame as opened
    integer, intent(in) :: motion_state
    real(wp), intent(in) :: h                     !! step
    real(wp), intent(in) :: z(max_states)         !! local coordinates at s = 0
    type(motion_t), intent(inout) :: motion       !! the step as a polynomial
    real(wp), intent(out) :: z_end(max_states)    !! local coordinates at s = h
    real(wp), intent(out) :: error(max_states)    !! estimated error of each coordinate
    type(step_t) :: step
    integer :: i
    logical :: done
    call system%stages(frame, motion_state, h, z, motion%kept, step, done)
    if (.not. done) call doubled_step(system, frame, motion_state, h, z, .true., step)
    motion%h = h
    motion%landing = step%landing
    do i = 1, system%n_states
      call read_step(step, h, z(i), i, motion%dense(:, i), error(i))
      z_end(i) = step%end(i)
    end do
  end subroutine rk4_step

  !> Dense output of one coordinate, and the estimate of its error.
  pure subroutine read_step(step, h, begin, i, dense, error)
    type(step_t), intent(in) :: step              !! the stages' results
    real(wp), intent(in) :: h                     !! step
    real(wp), intent(in) :: begin                 !! coordinate at s = 0
    integer, intent(in) :: i                      !! which
    real(wp), intent(out) :: dense(0:5)           !! as a polynomial
    real(wp), intent(out) :: error                !! its estimated error
    real(wp) :: slope, slope_end
    slope = h*step%rate_begin(i)
    slope_end = h*step%rate_end(i)
    call interpolate(begin, step%middle(i), step%end(i), slope, h*step%rate_middle(i), slope_end, &
        dense)
    error = abs(step%correction(i))
    if (error <= rounding*(abs(slope) + abs(slope_end)) + epsilon(error)*abs(begin)) error = 0
  end subroutine read_step

  !> Largest estimated error of a step in contact in units of the tolerance. Where that would refuse
  !> the step, what is rounding of the rates is left out: of terms of the coordinates' size that
  !> cancel, as in a tooth that creeps to rest. In contact time has the spring's unit, and position
  !> and velocity share another; a coordinate counts against its own scale.
  pure real(wp) function ratio_in_contact(h, z, error, scale, tolerance) result(ratio)
    real(wp), intent(in) :: h                     !! step
    real(wp), intent(in) :: z(:)                  !! coordinates at its beginning
    real(wp), intent(in) :: error(:)              !! estimated error of each
    real(wp), intent(in) :: scale(:)              !! natural size of each
    real(wp), intent(in) :: tolerance             !! relative tolerance of the run
    real(wp) :: size
    ratio = error_ratio(error, scale, tolerance)
    if (.not. ratio > 1) return
    size = maxval(abs(z)*(scale(1)/scale))
    ratio = error_ratio(merge(0.0_wp, error, error <= rounding*h*size), scale, tolerance)
  end function ratio_in_contact

  !> Where a step of length h ends, and nothing else.
  subroutine rk4_move(system, frame, motion_state, h, z, z_end)
    class(system_t), intent(in) :: system         !! what moves
    type(frame_t), intent(in) :: frame            !! frame as opened
    integer, intent(in) :: motion_state
    real(wp), intent(in) :: h                     !! step
    real(wp), intent(in) :: z(max_states)         !! local coordinates at s = 0
    real(wp), intent(out) :: z_end(max_states)    !! local coordinates at s = h
    type(step_t) :: step
    type(kept_t) :: kept
    logical :: done
    call system%stages(frame, motion_state, h, z, kept, step, done)
    if (.not. done) call doubled_step(system, frame, motion_state, h, z, .false., step)
    z_end = step%end
  end subroutine rk4_move

  !> Quintic Hermite interpolation at 0, 1/2 and 1 as coefficients of powers of s/h: of fifth order
  !> over the whole step, from values the step has anyway. Written in differences from the line
  !> through value and slope at 0, so that a short step keeps its relative precision.
  pure subroutine interpolate(begin, middle, end, slope, slope_middle, slope_end, c)
    real(wp), intent(in) :: begin, middle, end                  !! values
    real(wp), intent(in) :: slope, slope_middle, slope_end      !! h times the rates
    real(wp), intent(out) :: c(0:5)                             !! coefficients
    real(wp) :: u, w, e, f
    u = (middle - begin) - 0.5_wp*slope
    w = (end - begin) - slope
    e = slope_middle - slope
    f = slope_end - slope
    c(0) = begin
    c(1) = slope
    c(2) = 16*u + 7*w - 8*e - f
    c(3) = -32*u - 34*w + 32*e + 5*f
    c(4) = 16*u + 52*w - 40*e - 8*f
    c(5) = -24*w + 16*e + 4*f
  end subroutine interpolate
end module lapwing_flow_rk4_step
