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
  use lapwing_system_step, only: step_t, lengths_t, max_states, change, richardson
  implicit none
  private
  public :: rk4_step, take_stages, estimate_error, set_dense, ratio_beyond_rounding, rk4_move

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
    call take_stages(system, frame, motion_state, h, z, motion%lengths, step)
    call estimate_error(step, h, z(:system%n_states), error(:system%n_states))
    call set_dense(step, h, z, 1, system%n_states, motion)
    z_end(:system%n_states) = step%end(:system%n_states)
  end subroutine rk4_step

  !> The stages of a step, by the system or by the formula.
  subroutine take_stages(system, frame, motion_state, h, z, lengths, step)
    class(system_t), intent(in) :: system         !! what moves
    type(frame_t), intent(in) :: frame            !! frame as opened
    integer, intent(in) :: motion_state
    real(wp), intent(in) :: h                     !! step
    real(wp), intent(in) :: z(max_states)         !! local coordinates at s = 0
    type(lengths_t), intent(inout), optional :: lengths   !! lengths of late
    type(step_t), intent(inout) :: step           !! the result
    logical :: done
    call system%stages(frame, motion_state, h, z, lengths, step, done)
    if (.not. done) call doubled_step(system, frame, motion_state, h, z, .true., step)
  end subroutine take_stages

  !> Estimated error of each coordinate.
  pure subroutine estimate_error(step, h, begin, error)
    type(step_t), intent(in) :: step              !! the stages' results
    real(wp), intent(in) :: h                     !! step
    real(wp), intent(in) :: begin(:)              !! coordinates at s = 0
    real(wp), intent(out) :: error(:)             !! their estimated errors
    integer :: i
    ! Two coordinates: vectors of a length told at run time cost more than they save.
    !GCC$ novector
    do i = 1, size(begin)
      error(i) = abs(step%correction(i))
      if (error(i) <= rounding*h*(abs(step%rate_begin(i)) + abs(step%rate_end(i))) &
          + epsilon(error)*abs(begin(i))) error(i) = 0
    end do
  end subroutine estimate_error

  !> Dense output of some coordinates.
  pure subroutine set_dense(step, h, begin, first, last, motion)
    type(step_t), intent(in) :: step              !! the stages' results
    real(wp), intent(in) :: h                     !! step
    real(wp), intent(in) :: begin(max_states)     !! coordinates at s = 0
    integer, intent(in) :: first, last            !! which
    type(motion_t), intent(inout) :: motion       !! the step as a polynomial
    integer :: i
    motion%h = h
    motion%landing = step%landing
    do i = first, last
      call interpolate(begin(i), step%middle(i), step%end(i), h*step%rate_begin(i), &
          h*step%rate_middle(i), h*step%rate_end(i), motion%dense(:, i))
    end do
  end subroutine set_dense

  !> Largest estimated error of a step in contact in units of the tolerance, where that would refuse
  !> the step: without what is rounding of the rates, of terms of the coordinates' size that
  !> cancel, as in a tooth that creeps to rest. In contact time has the spring's unit, and position
  !> and velocity share another; a coordinate counts against its own scale.
  pure real(wp) function ratio_beyond_rounding(h, z, error, allowed) result(ratio)
    real(wp), intent(in) :: h                     !! step
    real(wp), intent(in) :: z(:)                  !! coordinates at its beginning
    real(wp), intent(in) :: error(:)              !! estimated error of each
    real(wp), intent(in) :: allowed(:)            !! error that each may have
    real(wp) :: size
    size = maxval(abs(z)*(allowed(1)/allowed))
    ratio = error_ratio(merge(0.0_wp, error, error <= rounding*h*size), allowed)
  end function ratio_beyond_rounding

  !> Where a step of length h ends, and nothing else.
  subroutine rk4_move(system, frame, motion_state, h, z, z_end)
    class(system_t), intent(in) :: system         !! what moves
    type(frame_t), intent(in) :: frame            !! frame as opened
    integer, intent(in) :: motion_state
    real(wp), intent(in) :: h                     !! step
    real(wp), intent(in) :: z(max_states)         !! local coordinates at s = 0
    real(wp), intent(out) :: z_end(max_states)    !! local coordinates at s = h
    type(step_t) :: step
    logical :: done
    call system%stages(frame, motion_state, h, z, step=step, done=done)
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
