!> The complete state of a run between two calls, and what one advance of it did.
module lapwing_hybrid_state
  use lapwing_kinds, only: wp
  use lapwing_codes, only: method_rk4
  use lapwing_polynomial_evaluation, only: horner
  use lapwing_flow_rk4_step_control, only: step_memory_t
  use lapwing_system, only: system_t, instant_t, frame_t, motion_t, max_states
  implicit none
  private
  public :: hybrid_state_t, numerics_t, event_t, segment_t, instant_in_segment

  !> Most events one segment can end with: kink, impact, release, engage.
  integer, parameter :: max_segment_events = 4

  !> What the automaton needs to go on, bit for bit.
  type :: hybrid_state_t
    type(instant_t) :: instant               !! where the system is
    type(step_memory_t) :: memory(0:2)       !! step rule's memory by motion state
    integer :: events_in_cycle = 0           !! events since the cycle began
    integer :: steps_in_cycle = 0            !! segments since the cycle began
  end type hybrid_state_t

  !> Tolerances and bounds.
  type :: numerics_t
    integer :: method = method_rk4                 !! how smooth pieces are moved along
    real(wp) :: tolerance = 1.0e-10_wp             !! relative, per step
    real(wp) :: chatter_tolerance = 1.0e-10_wp     !! of a chatter's end, mesh periods
    integer :: max_events_per_cycle = 1000000      !! bound on events
    integer :: max_steps_per_cycle = 10000000      !! bound on segments
    logical :: copy_repeats = .true.               !! cycles known already are not computed again
  end type numerics_t

  !> One line of the event log.
  type :: event_t
    integer :: kind = 0              !! event kind
    integer :: cycle = 0             !! mesh cycle
    real(wp) :: t = 0                !! time in it
    real(wp) :: phi = 0              !! displacement, rad
    real(wp) :: before = 0           !! velocity relative to the flank before, rad per tau
    real(wp) :: after = 0            !! and after
  end type event_t

  !> A stretch of smooth motion and the events it ends with.
  type :: segment_t
    integer :: motion_state = 0                       !! motion state during it
    integer :: cycle = 0                              !! cycle it began in
    real(wp) :: t = 0                                 !! time in it
    real(wp) :: length = 0                            !! duration
    logical :: stepped = .false.                      !! whether `motion` describes it
    logical :: closed = .false.                       !! or a closed form; if neither, the tooth
                                                      !! lies on the flank of its chart
    type(instant_t) :: begin                          !! where it began, in closed form
    type(frame_t) :: frame                            !! frame it began with
    type(motion_t) :: motion                          !! the step it is part of
    integer :: n_events = 0                           !! events at its end
    type(event_t) :: events(max_segment_events)       !! those events
    logical :: cycle_completed = .false.              !! whether it ends a cycle
  end type segment_t

contains

  !> Where the system is at s within a segment.
  subroutine instant_in_segment(system, segment, frame, s, instant)
    class(system_t), intent(in) :: system        !! what moves
    type(segment_t), intent(in) :: segment       !! what happened
    type(frame_t), intent(in) :: frame           !! frame on the piece that holds s
    real(wp), intent(in) :: s                    !! time since the segment began
    type(instant_t), intent(out) :: instant      !! where it is
    real(wp) :: z(max_states)
    integer :: i
    instant%motion_state = segment%motion_state
    instant%chart = frame%chart
    instant%cycle = segment%cycle
    instant%t = segment%t + s
    instant%piece = frame%piece
    if (segment%closed) call system%inside(segment%begin, s, instant%y)
    if (.not. segment%stepped) return
    z = 0
    do i = 1, system%n_states
      z(i) = horner(segment%motion%dense(:, i), s/segment%motion%h)
    end do
    call system%commit(frame, s, z, frame%chart, instant%y)
  end subroutine instant_in_segment
end module lapwing_hybrid_state
