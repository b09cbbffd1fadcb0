!> Contact events inside one step: every crossing of the dense output, isolated, then polished.
!>
!> The event function is the distance to a flank: dense output minus the table, piece by piece.
!> On each piece it is a polynomial of degree at most five whose first zero is isolated by
!> Bernstein sign variations, so that no crossing of the dense output is missed, whichever flank,
!> however many. A flank the tooth has just left is not disarmed for a time: its polynomial is
!> divided by its zero at the beginning of the step, and what remains is searched.
module lapwing_flow_rk4_crossing
  use lapwing_kinds, only: wp
  use lapwing_codes, only: separation
  use lapwing_polynomial_evaluation, only: max_degree
  use lapwing_polynomial_roots, only: first_descent
  use lapwing_flow, only: work_t
  use lapwing_flow_rk4_step, only: rk4_move
  use lapwing_system, only: system_t, frame_t, motion_t, max_states
  implicit none
  private
  public :: crossing_t, find_crossing, polish_crossing

  !> Re-steps of the formula to an event; two suffice unless the crossing is nearly a graze.
  integer, parameter :: max_polish = 8
  !> A polished event may leave the dense output's by this part of the step. Where it would go
  !> further the crossing is so shallow that dense output and formula disagree about it within
  !> the step's error; then the dense output decides. With 0.02
  !> and 0.1 random scenes have the same events.
  real(wp), parameter :: trust = 0.05_wp

  !> Where a step meets a flank.
  type :: crossing_t
    logical :: found = .false.   !! whether it does
    integer :: flank = 0         !! which flank
    real(wp) :: s = 0            !! when, since the frame was opened
    type(frame_t) :: frame       !! frame on the piece that holds s, or the step's end
  end type crossing_t

contains

  !> First crossing of a flank in (0, h]; without one, the frame on the piece that holds h.
  subroutine find_crossing(system, frame, motion_state, touching, motion, work, crossing)
    class(system_t), intent(in) :: system            !! what moves
    type(frame_t), intent(in) :: frame               !! frame as opened
    integer, intent(in) :: motion_state
    integer, intent(in) :: touching                  !! flank at zero distance at s = 0, or none
    type(motion_t), intent(in) :: motion             !! the step
    type(work_t), intent(inout) :: work              !! counts
    type(crossing_t), intent(inout) :: crossing      !! what was found
    integer :: touching_here
    logical :: clear
    crossing%found = .false.
    crossing%frame = frame
    touching_here = touching
    do
      call system%skip_ahead(motion_state, motion, crossing%frame, touching_here, clear)
      if (clear) return
      call search_piece(system, motion_state, touching_here, motion, work, crossing)
      if (crossing%found .or. crossing%frame%piece_end >= motion%h) return
      call system%next_piece(crossing%frame)
      touching_here = 0
    end do
  end subroutine find_crossing

  !> The same on one table piece, every flank that can be met there.
  subroutine search_piece(system, motion_state, touching, motion, work, crossing)
    class(system_t), intent(in) :: system            !! what moves
    integer, intent(in) :: motion_state
    integer, intent(in) :: touching                  !! flank at zero distance at the beginning
    type(motion_t), intent(in) :: motion             !! the step
    type(work_t), intent(inout) :: work              !! counts
    type(crossing_t), intent(inout) :: crossing      !! frame in, result out
    real(wp) :: c(0:max_degree), length, at
    integer :: flank
    logical :: found
    length = min(crossing%frame%piece_end, motion%h) - crossing%frame%piece_begin
    do flank = 1, system%n_flanks
      if (motion_state /= separation .and. motion_state /= flank) cycle
      call count_search(work, flank)
      call system%gap(crossing%frame, flank, motion, c)
      if (motion_state /= separation) c = -c
      if (flank == touching) c(0) = 0
      call first_descent(c, length, flank == touching, found, at)
      if (.not. found) cycle
      crossing%found = .true.
      crossing%flank = flank
      crossing%s = crossing%frame%piece_begin + at
      ! The other flank matters only before this.
      length = at
    end do
  end subroutine search_piece

  pure subroutine count_search(work, flank)
    type(work_t), intent(inout) :: work   !! counts
    integer, intent(in) :: flank          !! flank searched
    if (flank == 1) then
      work%drive_searches = work%drive_searches + 1
    else
      work%coast_searches = work%coast_searches + 1
    end if
  end subroutine count_search

  !> Move a crossing from the dense output's to the formula's: re-step from the beginning of the
  !> step to the event until the distance there vanishes (Newton in the step's length).
  subroutine polish_crossing(system, frame, motion_state, h, z, crossing, z_event, work)
    class(system_t), intent(in) :: system            !! what moves
    type(frame_t), intent(in) :: frame               !! frame as opened
    integer, intent(in) :: motion_state
    real(wp), intent(in) :: h                        !! step
    real(wp), intent(in) :: z(max_states)            !! local coordinates at s = 0
    type(crossing_t), intent(inout) :: crossing      !! dense crossing in, polished out
    real(wp), intent(out) :: z_event(max_states)     !! local coordinates at the event
    type(work_t), intent(inout) :: work              !! counts
    real(wp) :: s, dense_s, distance, approach, move, last_move, rate(max_states)
    integer :: i
    dense_s = crossing%s
    s = dense_s
    last_move = huge(s)
    rate = 0
    do i = 1, max_polish
      call rk4_move(system, frame, motion_state, s, z, z_event)
      work%polish_steps = work%polish_steps + 1
      call system%contact(crossing%frame, crossing%flank, s, z_event, distance, approach)
      crossing%s = s
      if (approach == 0) return
      move = distance/approach
      if (abs(move) >= 0.5_wp*last_move) return
      if (abs(move) <= 4*epsilon(s)*s) then
        ! The rest of the way is below the resolution of time, but not of the state: without it
        ! every event would lose some energy.
        call system%derivatives(frame, motion_state, s, z_event(1:system%n_states), &
            rate(1:system%n_states))
        z_event = z_event + move*rate
        crossing%s = s + move
        return
      end if
      if (abs(s + move - dense_s) > trust*h .or. s + move <= 0 .or. s + move > h) exit
      s = s + move
      last_move = abs(move)
    end do
    crossing%s = dense_s
    call rk4_move(system, frame, motion_state, dense_s, z, z_event)
  end subroutine polish_crossing
end module lapwing_flow_rk4_crossing
