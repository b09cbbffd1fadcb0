!> What a cycle comes to by integrals over its time: shares of the motion states, mean and mean
!> square of phi, mean and peak of the contact force. For studies that ask for them.
!>
!> Integrals over an arc by Gauss's rule with three nodes, in stretches so short that the natural
!> oscillation and 64 orders of the mesh frequency are smooth on them. A peak is looked for about
!> the nodes that might have it.
module lapwing_observers_averages
  use lapwing_kinds, only: wp
  use lapwing_codes, only: separation, back_engagement
  use lapwing_flow, only: flow_t, instant_on
  use lapwing_hybrid_state, only: segment_t
  use lapwing_observers_deviations, only: deviations_t
  use lapwing_system, only: system_t, instant_t, frame_t
  implicit none
  private
  public :: averages_t, average_columns, average, averages_row, averages_of

  !> Time by motion state; integrals of phi, phi**2 and force; the largest magnitude of the force.
  integer, parameter :: average_columns = 7

  !> Sums of the cycle under way.
  type :: averages_t
    real(wp) :: time(separation:back_engagement) = 0   !! tau by motion state
    real(wp) :: phi = 0                                !! rad tau
    real(wp) :: phi_square = 0                         !! rad**2 tau
    real(wp) :: force = 0                              !! rad tau
    real(wp) :: peak = 0                               !! rad
  end type averages_t

  !> A look at an arc: the force at one of its times, and the frame to look on from.
  type :: look_t
    real(wp) :: s = 0                                  !! time of the arc
    real(wp) :: size = 0                               !! magnitude of the force
    type(frame_t) :: frame                             !! frame there
  end type look_t

  !> Longest stretch, in tau and in mesh periods.
  real(wp), parameter :: longest = 0.25_wp, longest_part = 1.0_wp/64
  !> Stretches of an arc at most: what is slower than that in tau is smooth on longer ones.
  integer, parameter :: most_stretches = 100000
  real(wp), parameter :: node(3) = [-sqrt(0.6_wp), 0.0_wp, sqrt(0.6_wp)]
  real(wp), parameter :: weight(3) = [5.0_wp, 8.0_wp, 5.0_wp]/18

contains

  !> Add an arc.
  subroutine average(self, system, flow, deviations, segment)
    type(averages_t), intent(inout) :: self
    class(system_t), intent(in) :: system        !! what moves
    class(flow_t), intent(in) :: flow            !! what followed it
    type(deviations_t), intent(in) :: deviations !! of the system: its springs and dampers
    type(segment_t), intent(in) :: segment       !! what happened
    type(look_t) :: look(3)
    real(wp) :: width, force
    integer :: stretches, i, k
    if (segment%length <= 0) return
    associate (state => segment%begin%motion_state)
      self%time(state) = self%time(state) + segment%length
    end associate
    stretches = ceiling(min(real(most_stretches, wp), &
        segment%length/min(longest, longest_part*system%period)))
    width = segment%length/stretches
    look%frame = segment%frame
    call look_on(system, flow, deviations, segment, 0.0_wp, look(3), force)
    self%peak = max(self%peak, look(3)%size)
    look(2) = look(3)
    do i = 1, stretches
      do k = 1, 3
        call step_on((i - 0.5_wp + 0.5_wp*node(k))*width, weight(k)*width)
      end do
    end do
    call step_on(segment%length, 0.0_wp)
    self%peak = max(self%peak, look(3)%size)

  contains

    !> Go on to the next look, add it with its weight, and see whether the last one was a peak.
    subroutine step_on(s, share)
      real(wp), intent(in) :: s                  !! time of the arc
      real(wp), intent(in) :: share              !! its weight in the integrals
      real(wp) :: phi, bend
      look(1) = look(2)
      look(2) = look(3)
      call look_on(system, flow, deviations, segment, s, look(3), force, phi)
      self%phi = self%phi + share*phi
      self%phi_square = self%phi_square + share*phi**2
      self%force = self%force + share*force
      bend = 2*look(2)%size - look(1)%size - look(3)%size
      if (look(2)%size < max(look(1)%size, look(3)%size)) return
      ! The parabola through three looks is higher than the middle one by less than its bend.
      if (look(2)%size + bend > self%peak) self%peak = max(self%peak, &
          largest_between(system, flow, deviations, segment, look))
    end subroutine step_on
  end subroutine average

  !> Force and displacement at a time of an arc.
  subroutine look_on(system, flow, deviations, segment, s, look, force, phi)
    class(system_t), intent(in) :: system        !! what moves
    class(flow_t), intent(in) :: flow            !! what followed it
    type(deviations_t), intent(in) :: deviations !! of the system: its springs and dampers
    type(segment_t), intent(in) :: segment       !! the arc
    real(wp), intent(in) :: s                    !! time since it began
    type(look_t), intent(inout) :: look          !! an earlier look; then this one
    real(wp), intent(out) :: force               !! rad
    real(wp), intent(out), optional :: phi       !! rad
    type(instant_t) :: instant
    real(wp) :: phi_dot, depth
    call instant_on(flow, system, segment%arc_t, s, look%frame, instant)
    force = 0
    ! The acceleration that a deviation from the flank at rest has more than in flight, reversed.
    if (instant%motion_state /= separation) then
      associate (a => deviations%a(2, :, instant%motion_state))
        force = -(a(1)*instant%y(1) + a(2)*instant%y(2))
      end associate
    end if
    look%s = s
    look%size = abs(force)
    if (.not. present(phi)) return
    call system%observe(instant, depth, phi_dot)
    phi = depth
  end subroutine look_on

  !> Largest magnitude of the force about the second of three looks, by golden section.
  real(wp) function largest_between(system, flow, deviations, segment, look) result(largest)
    class(system_t), intent(in) :: system        !! what moves
    class(flow_t), intent(in) :: flow            !! what followed it
    type(deviations_t), intent(in) :: deviations !! of the system: its springs and dampers
    type(segment_t), intent(in) :: segment       !! the arc
    type(look_t), intent(in) :: look(3)          !! the second is the largest
    real(wp), parameter :: golden = 0.5_wp*(sqrt(5.0_wp) - 1)
    integer, parameter :: halvings = 40
    type(look_t) :: inner(2)
    real(wp) :: low, high
    integer :: i
    low = look(1)%s
    high = look(3)%s
    largest = look(2)%size
    inner = [look_between(high - golden*(high - low)), look_between(low + golden*(high - low))]
    do i = 1, halvings
      largest = max(largest, maxval(inner%size))
      if (inner(1)%size >= inner(2)%size) then
        high = inner(2)%s
        inner = [look_between(high - golden*(high - low)), inner(1)]
      else
        low = inner(1)%s
        inner = [inner(2), look_between(low + golden*(high - low))]
      end if
    end do

  contains

    type(look_t) function look_between(s) result(found)
      real(wp), intent(in) :: s                  !! time of the arc
      real(wp) :: force
      found = look(1)
      call look_on(system, flow, deviations, segment, s, found, force)
    end function look_between
  end function largest_between

  !> The columns of a cycle.
  pure function averages_row(self) result(row)
    type(averages_t), intent(in) :: self
    real(wp) :: row(average_columns)
    row = [self%time, self%phi, self%phi_square, self%force, self%peak]
  end function averages_row

  !> Those of several cycles together.
  pure function averages_of(rows) result(row)
    real(wp), intent(in) :: rows(:, :)           !! (average_columns, n) a line for each cycle
    real(wp) :: row(average_columns)
    row = sum(rows, 2)
    row(average_columns) = maxval(rows(average_columns, :))
  end function averages_of
end module lapwing_observers_averages
