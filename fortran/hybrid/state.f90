!> The complete state of a run between two calls, and what one advance of it did.
module lapwing_hybrid_state
  use lapwing_kinds, only: wp
  use lapwing_codes, only: method_rk4
  use lapwing_flow, only: arc_t, step_memory_t
  use lapwing_system, only: instant_t
  implicit none
  private
  public :: hybrid_state_t, numerics_t, event_t, segment_t

  !> Most events one segment can end with: kink, impact, release, engage.
  integer, parameter :: max_segment_events = 4

  !> What the automaton needs to go on, bit for bit.
  type :: hybrid_state_t
    type(instant_t) :: instant               !! where the system is
    type(step_memory_t) :: memory(0:2)       !! step rule's memory by motion state
    integer :: events_in_cycle = 0           !! events since the cycle began
    integer :: steps_in_cycle = 0            !! arcs since the cycle began
    !> Of flights that begin and end at the drive flank in this cycle, with no kink on the way: the
    !> rebound speed of the one under way, and the fastest of those that have ended; 0: none.
    real(wp) :: leaving = 0, fastest = 0
  end type hybrid_state_t

  !> Tolerances and bounds.
  type :: numerics_t
    integer :: method = method_rk4                 !! how smooth pieces are moved along
    real(wp) :: tolerance = 1.0e-10_wp             !! relative, per step
    real(wp) :: chatter_tolerance = 1.0e-10_wp     !! of a chatter's end, mesh periods
    integer :: max_events_per_cycle = 1000000      !! bound on events
    integer :: max_steps_per_cycle = 10000000      !! bound on arcs
    logical :: copy_repeats = .true.               !! cycles known already are not computed again
    logical :: sum_early = .false.                 !! bounces that do not count may be summed
    real(wp) :: count_depth = 0                    !! least depth that counts, part of the deepest
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

  !> An arc and the events it ends with.
  type, extends(arc_t) :: segment_t
    integer :: n_events = 0                           !! events at its end
    type(event_t) :: events(max_segment_events)       !! those events
    logical :: cycle_completed = .false.              !! whether it ends a cycle
    logical :: unseen = .false.                       !! whether nobody looks at steps in contact
  end type segment_t
end module lapwing_hybrid_state
