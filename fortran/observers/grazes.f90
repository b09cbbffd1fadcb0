!> Near-grazes: where an arc comes near a flank, or near release, and turns back.
module lapwing_observers_grazes
  use lapwing_kinds, only: wp
  use lapwing_codes, only: event_near_graze, event_kind
  use lapwing_flow, only: flow_t, work_t, listener_t
  use lapwing_hybrid_state, only: segment_t, event_t
  use lapwing_observers_records, only: recorder_t, log_line
  use lapwing_system, only: system_t, instant_t
  implicit none
  private
  public :: find_grazes

  !> Writes into the log what lies in the time asked about.
  type, extends(listener_t) :: graze_log_t
    type(recorder_t), pointer :: recorder => null()      !! whose log it is
    class(system_t), pointer :: system => null()         !! what moves
    real(wp) :: until = huge(1.0_wp)                     !! time in the cycle: later ones wait
  contains
    procedure :: hear
  end type graze_log_t

contains

  !> Log where an arc comes near a flank, or near release, and turns back.
  subroutine find_grazes(self, system, flow, segment, until, work)
    type(recorder_t), intent(inout), target :: self
    class(system_t), intent(in), target :: system    !! what moves
    class(flow_t), intent(in) :: flow                !! what followed it
    type(segment_t), intent(in) :: segment           !! what happened
    real(wp), intent(in) :: until                    !! time in the cycle: later ones wait
    type(work_t), intent(inout) :: work              !! counts
    type(graze_log_t) :: graze_log
    graze_log%recorder => self
    graze_log%system => system
    graze_log%until = until
    call flow%near_turns(system, segment%arc_t, self%graze_distance, graze_log, work)
  end subroutine find_grazes

  !> Log a near-graze in the time asked about.
  subroutine hear(self, flank, instant)
    class(graze_log_t), intent(inout) :: self
    integer, intent(in) :: flank                     !! flank
    type(instant_t), intent(in) :: instant           !! where the distance turns
    type(event_t) :: event
    if (instant%t <= self%recorder%sums%grazes_known_to .or. instant%t > self%until) return
    event%kind = event_kind(event_near_graze, flank)
    event%cycle = instant%cycle
    event%t = instant%t
    call self%system%observe(instant, event%phi, event%before)
    event%after = event%before
    call log_line(self%recorder, event)
  end subroutine hear
end module lapwing_observers_grazes
