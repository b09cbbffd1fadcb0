!> One smooth stretch of any system: the short way where it is a plain one, else by the automaton.
module lapwing_hybrid_advance
  use lapwing_hybrid_automaton, only: advance, check_bounds
  use lapwing_flow_rk4_crossing, only: work_t
  use lapwing_hybrid_exact_automaton, only: advance_plainly
  use lapwing_flow_exact_exact_oscillator, only: exact_oscillator_t
  use lapwing_hybrid_state, only: hybrid_state_t, numerics_t, segment_t
  use lapwing_system_oscillator, only: oscillator_t
  use lapwing_hybrid_plain_contact, only: step_in_contact
  use lapwing_system, only: system_t
  implicit none
  private
  public :: advance_any

contains

  !> Advance any system by one smooth stretch.
  subroutine advance_any(system, numerics, state, segment, work, status)
    class(system_t), intent(in) :: system           !! what moves
    type(numerics_t), intent(in) :: numerics        !! tolerances and bounds
    type(hybrid_state_t), intent(inout) :: state    !! state, moved on
    type(segment_t), intent(inout) :: segment       !! what happened
    type(work_t), intent(inout) :: work             !! counts
    integer, intent(out) :: status                  !! status_*
    logical :: done
    done = .false.
    select type (system)
    type is (exact_oscillator_t)
      call advance_plainly(system, state, segment, done)
      if (done) work%stretches = work%stretches + 1
    type is (oscillator_t)
      call step_in_contact(system, numerics, state, segment, work, done)
    end select
    if (done) then
      call check_bounds(system, numerics, state, segment, status)
    else
      call advance(system, numerics, state, segment, work, status)
    end if
  end subroutine advance_any
end module lapwing_hybrid_advance
