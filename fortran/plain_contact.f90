!> A step in contact as most are: accepted at once, and nowhere near the flank's surface. It does what
!> `lapwing_automaton` does, to the same bit, with everything about the oscillator known; whatever is
!> special it leaves untouched to the automaton.
module lapwing_plain_contact
  use lapwing_kinds, only: wp
  use lapwing_automaton, only: end_of_step
  use lapwing_clearance, only: stays_inside
  use lapwing_codes, only: separation, drive_flank
  use lapwing_event_search, only: work_t
  use lapwing_hybrid_state, only: hybrid_state_t, numerics_t, segment_t
  use lapwing_flank_frames, only: open_folded
  use lapwing_oscillator, only: oscillator_t, drive_over_step
  use lapwing_rk4, only: read_step
  use lapwing_spring_stages, only: spring_stages
  use lapwing_step_control, only: step_to_try, error_ratio, after_accepted
  use lapwing_system, only: step_t
  implicit none
  private
  public :: step_in_contact

contains

  !> One step in contact, if it is a plain one; otherwise the state is as it was.
  subroutine step_in_contact(self, numerics, state, segment, work, done)
    type(oscillator_t), intent(in) :: self          !! what moves
    type(numerics_t), intent(in) :: numerics        !! tolerance
    type(hybrid_state_t), intent(inout) :: state    !! state
    type(segment_t), intent(inout) :: segment       !! what happened
    type(work_t), intent(inout) :: work             !! counts
    logical, intent(out) :: done                    !! whether it was
    type(step_t) :: step
    real(wp) :: driven(4), landing(2), error(2), h, ratio
    logical :: cut_short
    integer :: i
    done = .false.
    associate (instant => state%instant, motion => segment%motion)
      if (instant%motion_state == separation .or. self%rigid .or. .not. self%alike) return
      if (instant%touching /= instant%motion_state) then
        if (.not. merge(instant%y(1), -instant%y(1), instant%motion_state == drive_flank) > 0) &
            return
      end if
      call open_folded(self%table, instant, segment%frame)
      associate (memory => state%memory(instant%motion_state))
        h = step_to_try(memory, .true., numerics%tolerance)
        cut_short = segment%frame%stop < h
        h = min(h, segment%frame%stop)
        call drive_over_step(self, segment%frame, h, driven, landing)
        call spring_stages(self%damping, self%force, driven, h, instant%y(1:2), step)
        motion%h = h
        do i = 1, 2
          call read_step(step, h, instant%y(i), i, motion%dense(:, i), error(i))
        end do
        ratio = error_ratio(error, [self%angle_scale, self%angle_scale], numerics%tolerance)
        if (.not. ratio <= 1) return
        done = stays_inside(self%table%push(instant%motion_state), instant%motion_state, &
            instant%touching, motion)
        if (.not. done) return
        segment%motion_state = instant%motion_state
        segment%cycle = instant%cycle
        segment%t = instant%t
        instant%y(1:2) = step%end(1:2) - landing
        call after_accepted(memory, h, ratio, cut_short)
      end associate
    end associate
    work%steps = work%steps + 1
    segment%stepped = .true.
    segment%closed = .false.
    segment%n_events = 0
    segment%cycle_completed = .false.
    call end_of_step(self, state, segment)
  end subroutine step_in_contact
end module lapwing_plain_contact
