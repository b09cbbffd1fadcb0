!> Ways of moving along smooth arcs. An arc lasts from one instant to the first guard, a flank met
!> or a contact that comes to zero, or to its stop: the next kink or the end of the cycle.
!>
!> Whoever looks at an arc asks the flow that followed it, and need not know which one that was.
module lapwing_flow
  use lapwing_kinds, only: wp
  use lapwing_flank_series, only: turned_t
  use lapwing_system, only: system_t, instant_t, frame_t, motion_t, max_states
  implicit none
  private
  public :: flow_t, arc_t, reached_t, work_t, step_memory_t, listener_t, instant_on, at_stop
  public :: curve_t, start_order

  integer, parameter :: start_order = 13   !! highest order of a series about an arc's beginning

  !> One arc in closed form, seen from a flank: see `lapwing_flow_exact_curve`.
  type :: curve_t
    logical :: contact = .false.          !! in contact, or in flight
    integer :: degree = -1                !! of its series, as far as it is known
    integer :: piece = 1                  !! piece of the flank at the beginning
    real(wp) :: t = 0                     !! cycle time of s = 0
    real(wp) :: x = 0, v = 0              !! position and velocity there
    real(wp) :: near = -1                 !! the Taylor series holds up to this s
    real(wp) :: taylor(0:start_order)     !! of x about s = 0, once expanded
    real(wp) :: flank(2) = 0              !! g and g' at s = 0, in flight
    real(wp) :: free(2) = 0               !! d and d' at s = 0, in contact
    logical :: is_turned = .false.        !! whether the series' terms at s = 0 are known
    type(turned_t) :: turned              !! those
  end type curve_t

  !> One arc.
  type :: arc_t
    type(instant_t) :: begin             !! where it begins
    real(wp) :: length = 0               !! duration
    logical :: moves = .false.           !! whether a flow followed it; else the tooth lies on the
                                         !! flank of its chart
    integer :: may_skip = 0              !! steps in contact that may be taken before it, of which
                                         !! nobody hears: it then begins where they end
    integer :: skipped = 0               !! and how many were
    type(frame_t) :: frame               !! frame it began with; its stop, if no flow asks for more
    type(motion_t) :: motion             !! step it is part of, where the flow takes steps
    type(curve_t) :: curve               !! curve it was followed by last, where it takes none
  end type arc_t

  !> The end of an arc. Nothing is set beforehand: an arc is too short for that.
  type :: reached_t
    integer :: flank                     !! flank met, or none
    real(wp) :: s                        !! duration
    integer :: chart                     !! flank that y refers to: the one met, if any
    integer :: piece                     !! piece of the flank's motion, where to look first
    real(wp) :: y(max_states)            !! state variables, before whatever happens there
    real(wp) :: flank_velocity           !! of the flank met, where the impact law asks for it
  end type reached_t

  !> What was done, for tests of "no more than the scene needs" and for benchmarks.
  type :: work_t
    real(wp) :: steps = 0                !! accepted steps
    real(wp) :: rejected = 0             !! rejected steps
    real(wp) :: polish_steps = 0         !! re-steps to events
    real(wp) :: drive_searches = 0       !! pieces searched at the drive flank
    real(wp) :: coast_searches = 0       !! pieces searched at the coast flank
    real(wp) :: samples = 0              !! samples of the history evaluated
    real(wp) :: depth_searches = 0       !! pieces searched for the deepest point
    real(wp) :: graze_searches = 0       !! pieces searched for near-grazes
    real(wp) :: arcs = 0                 !! arcs followed in closed form
  end type work_t

  !> What a step rule remembers of one motion state.
  type :: step_memory_t
    real(wp) :: step = huge(1.0_wp)      !! step to try next; huge: nothing is known
    real(wp) :: ratio = 1                !! error ratio of the step before
  end type step_memory_t

  !> Hears where an arc turns near a flank.
  type, abstract :: listener_t
  contains
    procedure(hear_i), deferred :: hear
  end type listener_t

  type, abstract :: flow_t
    logical :: takes_steps = .true.      !! whether every arc needs its frame
  contains
    procedure(open_i), deferred :: open
    procedure(advance_i), deferred :: advance
    procedure(state_at_i), deferred :: state_at
    procedure(farthest_i), deferred :: farthest
    procedure(near_turns_i), deferred :: near_turns
    procedure :: rigid_release => not_known
    procedure :: change_force => unchanged
  end type flow_t

  abstract interface
    !> Where the distance to a flank is least, or that from release.
    subroutine hear_i(self, flank, instant)
      import :: listener_t, instant_t
      implicit none
      class(listener_t), intent(inout) :: self
      integer, intent(in) :: flank
      type(instant_t), intent(in) :: instant        !! where the system is then
    end subroutine hear_i

    !> Frame of the arc that begins at an instant.
    subroutine open_i(self, system, instant, frame)
      import :: flow_t, system_t, instant_t, frame_t
      implicit none
      class(flow_t), intent(in) :: self
      class(system_t), intent(in) :: system         !! what moves
      type(instant_t), intent(in) :: instant        !! where the arc begins
      type(frame_t), intent(inout) :: frame         !! its frame
    end subroutine open_i

    !> Follow an arc to the first guard or its stop, or part of the way.
    subroutine advance_i(self, system, tolerance, opened, arc, memory, reached, work, status)
      import :: flow_t, system_t, arc_t, step_memory_t, reached_t, work_t, wp
      implicit none
      class(flow_t), intent(in) :: self
      class(system_t), intent(in) :: system         !! what moves
      real(wp), intent(in) :: tolerance             !! relative, per step
      logical, intent(in) :: opened                 !! whether the arc's frame is
      type(arc_t), intent(inout) :: arc             !! the arc
      type(step_memory_t), intent(inout) :: memory(0:)   !! by motion state
      type(reached_t), intent(inout) :: reached     !! its end
      type(work_t), intent(inout) :: work           !! counts
      integer, intent(out) :: status                !! status_*
    end subroutine advance_i

    !> State variables at a time of an arc, in its chart.
    subroutine state_at_i(self, system, arc, s, frame, y)
      import :: flow_t, system_t, arc_t, frame_t, max_states, wp
      implicit none
      class(flow_t), intent(in) :: self
      class(system_t), intent(in) :: system         !! what moves
      type(arc_t), intent(in) :: arc                !! an arc it moved along
      real(wp), intent(in) :: s                     !! time since it began
      type(frame_t), intent(inout) :: frame         !! the arc's, or where the last look left it
      real(wp), intent(out) :: y(max_states)        !! state variables
    end subroutine state_at_i

    !> Largest distance from the drive flank, or depth in the coast flank, over an arc, if it
    !> exceeds `least`; else `least`.
    subroutine farthest_i(self, system, arc, flank, least, largest, work)
      import :: flow_t, system_t, arc_t, work_t, wp
      implicit none
      class(flow_t), intent(in) :: self
      class(system_t), intent(in) :: system         !! what moves
      type(arc_t), intent(in) :: arc                !! an arc it moved along
      integer, intent(in) :: flank
      real(wp), intent(in) :: least                 !! value known already, rad
      real(wp), intent(out) :: largest              !! the larger of the two, rad
      type(work_t), intent(inout) :: work           !! counts
    end subroutine farthest_i

    !> Report where an arc comes near a flank, or near release, and turns back.
    subroutine near_turns_i(self, system, arc, within, listener, work)
      import :: flow_t, system_t, arc_t, listener_t, work_t, wp
      implicit none
      class(flow_t), intent(in) :: self
      class(system_t), intent(in) :: system         !! what moves
      type(arc_t), intent(in) :: arc                !! an arc it moved along
      real(wp), intent(in) :: within                !! what is near, rad
      class(listener_t), intent(inout) :: listener  !! who hears of it
      type(work_t), intent(inout) :: work           !! counts
    end subroutine near_turns_i
  end interface

contains

  !> Where the system is at a time of an arc.
  subroutine instant_on(flow, system, arc, s, frame, instant)
    class(flow_t), intent(in) :: flow               !! what followed it
    class(system_t), intent(in) :: system           !! what moves
    type(arc_t), intent(in) :: arc                  !! the arc
    real(wp), intent(in) :: s                       !! time since it began
    type(frame_t), intent(inout) :: frame           !! its frame, or where the last look left it
    type(instant_t), intent(out) :: instant         !! where it is
    if (arc%moves) then
      call flow%state_at(system, arc, s, frame, instant%y)
    else if (system%n_states > 2) then
      call move_others(system, arc, s, instant%y)
    end if
    instant%motion_state = arc%begin%motion_state
    instant%chart = frame%chart
    instant%cycle = arc%begin%cycle
    instant%t = arc%begin%t + s
    instant%piece = frame%piece
  end subroutine instant_on

  !> Where the tooth lies on its flank, the rest of a summed chatter, other states move at the rates
  !> with which it began: it is so short that these do not change.
  subroutine move_others(system, arc, s, y)
    class(system_t), intent(in) :: system           !! what moves
    type(arc_t), intent(in) :: arc                  !! the arc
    real(wp), intent(in) :: s                       !! time since it began
    real(wp), intent(inout) :: y(max_states)        !! state variables: all but the tooth's
    real(wp) :: rate(system%n_states)
    associate (n => system%n_states, begin => arc%begin)
      call system%derivatives(arc%frame, begin%motion_state, 0.0_wp, begin%y(:n), rate)
      y(3:n) = begin%y(3:n) + s*rate(3:)
    end associate
  end subroutine move_others

  !> Equal times, to the resolution of time: what happens at the stop, a kink or the end of the
  !> cycle, comes before an event at a flank.
  pure logical function at_stop(frame, s)
    type(frame_t), intent(in) :: frame   !! frame as opened
    real(wp), intent(in) :: s            !! time of the event since then
    real(wp) :: ends
    ends = frame%t + frame%stop
    ! `spacing` is slow, and most events are nowhere near.
    at_stop = frame%t + s >= ends*(1 - 2*epsilon(s))
    if (at_stop) at_stop = frame%t + s >= ends - spacing(ends)
  end function at_stop

  !> When a tooth in rigid contact would be pulled, where a flow knows that better than the pieces
  !> of the flank's motion do.
  subroutine not_known(self, system, instant, stop, known, found, s)
    class(flow_t), intent(in) :: self
    class(system_t), intent(in) :: system           !! what moves
    type(instant_t), intent(in) :: instant          !! where the tooth is
    real(wp), intent(in) :: stop                    !! latest end
    logical, intent(out) :: known                   !! whether it does
    logical, intent(out) :: found                   !! whether the tooth would be pulled
    real(wp), intent(out) :: s                      !! when
    known = .false.
    found = .false.
    s = stop
  end subroutine not_known

  !> The system has come under another force.
  subroutine unchanged(self, force)
    class(flow_t), intent(inout) :: self
    real(wp), intent(in) :: force                   !! F
  end subroutine unchanged
end module lapwing_flow
