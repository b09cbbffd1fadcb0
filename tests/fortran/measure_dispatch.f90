!> The price of generality, in nanoseconds (not a test): `meson compile measure_dispatch` in a
!> release build, then run it. A step with the gear's own stages against the formula, and
!> whole calls of `advance`.
program measure_dispatch
  use lapwing_codes, only: separation, engagement, law_compliant, law_restitution, gap_one_flank
  use lapwing_flow, only: work_t
  use lapwing_flow_rk4_rk4_flow, only: rk4_flow_t
  use lapwing_hybrid_automaton, only: advance
  use lapwing_hybrid_state, only: hybrid_state_t, numerics_t, segment_t
  use lapwing_kinds, only: wp, int64
  use lapwing_system_oscillator, only: oscillator_t
  use test_systems, only: oscillator
  use lapwing_system_parameters, only: parameters_t
  use lapwing_flow_rk4_step, only: rk4_step
  use lapwing_system_start, only: start_from, start_at_rest
  use lapwing_system, only: system_t, instant_t, frame_t, motion_t, max_states
  use test_systems, only: dispatched_t
  implicit none

  integer, parameter :: repetitions = 7, steps = 1000000, pieces = 32
  type(oscillator_t) :: gear
  type(dispatched_t) :: dispatched

  gear = some_gear(3.0_wp, law_compliant)
  dispatched%inner = gear
  call report_step("step in contact, own stages ", gear, engagement)
  call report_step("step in contact, by dispatch", dispatched, engagement)
  call report_step("step in flight,  own stages ", gear, separation)
  call report_step("step in flight,  by dispatch", dispatched, separation)
  call report_advance("advance, always in contact ", some_gear(3.0_wp, law_compliant))
  call report_advance("advance, bouncing          ", some_gear(0.06_wp, law_restitution))

contains

  !> A smooth flank of `pieces` cubics, cos(2 pi phase) interpolated with its slopes.
  function some_gear(force, contact_law) result(self)
    real(wp), intent(in) :: force            !! F, rad; the flank's amplitude is 1
    integer, intent(in) :: contact_law       !! law_*
    type(oscillator_t) :: self
    type(parameters_t) :: p
    real(wp), parameter :: two_pi = 8*atan(1.0_wp), width = 1.0_wp/pieces
    real(wp) :: knots(pieces + 1), c(0:5, pieces), g(2), slope(2)
    integer :: i
    p%force = force
    p%mesh_frequency_ratio = 0.3_wp
    p%damping_ratio = 0.1_wp
    p%restitution = 0.8_wp
    p%contact_law = contact_law
    p%gap = gap_one_flank
    p%backlash = 10
    p%peak_to_peak = 2
    knots = [(i*width, i = 0, pieces)]
    c = 0
    do i = 1, pieces
      g = cos(two_pi*knots(i:i + 1))
      slope = -two_pi*sin(two_pi*knots(i:i + 1))
      c(0:1, i) = [g(1), slope(1)]
      c(2, i) = (3*(g(2) - g(1))/width - 2*slope(1) - slope(2))/width
      c(3, i) = (slope(1) + slope(2) - 2*(g(2) - g(1))/width)/width**2
    end do
    self = oscillator(p, knots, c, spread(.false., 1, pieces))
  end function some_gear

  !> Best of some runs of `rk4_step` over 0.05 tau.
  subroutine report_step(name, system, motion_state)
    character(*), intent(in) :: name         !! what
    class(system_t), intent(in) :: system    !! what moves
    integer, intent(in) :: motion_state      !! motion state
    type(instant_t) :: instant
    type(frame_t) :: frame
    type(motion_t) :: motion
    real(wp) :: z(max_states), z_end(max_states), error(max_states), best, began
    integer :: i, k
    instant = start_from(gear, 0.01_wp, motion_state, merge(1.0_wp, -1.0_wp, &
        motion_state == engagement), 0.1_wp)
    call gear%open_frame(instant, frame)
    z = instant%y
    best = huge(best)
    do k = 1, repetitions
      began = seconds()
      do i = 1, steps
        call rk4_step(system, frame, motion_state, 0.05_wp, z, motion, z_end, error)
        z(2) = z(2) + 1.0e-9_wp*error(1)
      end do
      best = min(best, seconds() - began)
    end do
    print "(2a, f8.1, a)", name, ": ", 1.0e9_wp*best/steps, " ns per step"
  end subroutine report_step

  !> Best of some runs of 1e6 calls of `advance`, from rest, and what they consisted of.
  subroutine report_advance(name, system)
    character(*), intent(in) :: name         !! what
    type(oscillator_t), intent(in) :: system !! what moves
    type(hybrid_state_t) :: state
    type(numerics_t) :: numerics
    type(segment_t) :: segment
    type(work_t) :: work
    real(wp) :: best, began
    integer :: i, k, status
    best = huge(best)
    do k = 1, repetitions
      state = hybrid_state_t()
      state%instant = start_at_rest(system, 0.0_wp)
      work = work_t()
      began = seconds()
      do i = 1, steps
        call advance(system, rk4_flow_t(), numerics, state, segment, work, status)
        if (status /= 0) error stop "advance failed"
      end do
      best = min(best, seconds() - began)
    end do
    print "(2a, f8.1, a, 4(f6.2, a))", name, ": ", 1.0e9_wp*best/steps, " ns per call (", &
        work%steps/steps, " steps, ", work%rejected/steps, " rejected, ", &
        work%drive_searches/steps, " searches, ", work%polish_steps/steps, " polish steps per call)"
  end subroutine report_advance

  real(wp) function seconds()
    integer(int64) :: count, rate
    call system_clock(count, rate)
    seconds = real(count, wp)/real(rate, wp)
  end function seconds
end program measure_dispatch
