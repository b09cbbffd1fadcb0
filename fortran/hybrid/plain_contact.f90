!> A step in contact as most are: accepted at once, and nowhere near the flank's surface. It does
!> what `lapwing_hybrid_automaton` does, to the same bit, with everything about the oscillator
!> known; whatever is special it leaves untouched to the automaton.
module lapwing_hybrid_plain_contact
  use lapwing_kinds, only: wp
  use lapwing_hybrid_automaton, only: end_of_step
  use lapwing_system_clearance, only: stays_inside
  use lapwing_codes, only: separation, drive_flank
  use lapwing_flow_rk4_crossing, only: work_t
  use lapwing_hybrid_state, only: hybrid_state_t, numerics_t, segment_t
  use lapwing_system_frames, only: open_in_contact
  use lapwing_system_oscillator, only: oscillator_t, drive_over_step
  use lapwing_flow_rk4_step, only: read_step, ratio_in_contact
  use lapwing_system_spring_stages, only: spring_stages
  use lapwing_flow_rk4_step_control, only: step_to_try, after_accepted
  use lapwing_system, only: instant_t, frame_t, motion_t, step_t
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
    real(wp) :: h, ratio, landed(2)
    logical :: cut_short
    done = .false.
    associate (instant => state%instant)
      if (.not. begins_inside(self, instant)) return
      call open_in_contact(self%table, self%width, instant, segment%frame)
      associate (memory => state%memory(instant%motion_state))
        h = step_to_try(memory, .true., numerics%tolerance)
        cut_short = segment%frame%stop < h
        h = min(h, segment%frame%stop)
        call try_step(self, segment%frame, h, instant%y(1:2), numerics%tolerance, &
            segment%motion, landed, ratio)
        if (.not. ratio <= 1) return
        done = stays_inside(self%table%push(instant%motion_state), instant%motion_state, &
            instant%touching, segment%motion)
        if (.not. done) return
        call after_accepted(memory, h, ratio, cut_short)
      end associate
      segment%motion_state = instant%motion_state
      segment%cycle = instant%cycle
      segment%t = instant%t
      instant%y(1:2) = landed
    end associate
    work%steps = work%steps + 1
    segment%stepped = .true.
    segment%closed = .false.
    segment%n_events = 0
    segment%cycle_completed = .false.
    call end_of_step(self, state, segment)
  end subroutine step_in_contact

  !> Whether a tooth is in contact with a flank that moves, and inside it or on the way into it.
  pure logical function begins_inside(self, instant)
    type(oscillator_t), intent(in) :: self          !! what moves
    type(instant_t), intent(in) :: instant          !! where it is
    begins_inside = .false.
    if (instant%motion_state == separation .or. self%rigid .or. .not. self%alike) return
    begins_inside = instant%touching == instant%motion_state
    if (begins_inside) return
    begins_inside = merge(instant%y(1), -instant%y(1), instant%motion_state == drive_flank) > 0
  end function begins_inside

  !> A step, its dense output and the ratio of its error to what is allowed.
  pure subroutine try_step(self, frame, h, y, tolerance, motion, landed, ratio)
    type(oscillator_t), intent(in) :: self          !! what moves
    type(frame_t), intent(in) :: frame              !! frame as opened
    real(wp), intent(in) :: h                       !! step
    real(wp), intent(in) :: y(2)                    !! position and velocity at its beginning
    real(wp), intent(in) :: tolerance               !! relative tolerance
    type(motion_t), intent(inout) :: motion         !! the step as a polynomial
    real(wp), intent(out) :: landed(2)              !! position and velocity at its end
    real(wp), intent(out) :: ratio                  !! error ratio
    type(step_t) :: step
    real(wp) :: driven(4), landing(2), error(2)
    integer :: i
    call drive_over_step(self, frame, h, driven, landing)
    call spring_stages(self%damping, self%force, driven, h, y, step)
    motion%h = h
    do i = 1, 2
      call read_step(step, h, y(i), i, motion%dense(:, i), error(i))
    end do
    landed = step%end(1:2) - landing
    ratio = ratio_in_contact(h, y, error, [self%angle_scale, self%angle_scale], tolerance)
  end subroutine try_step
end module lapwing_hybrid_plain_contact
