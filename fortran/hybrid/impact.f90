!> What happens at a flank: arrival, impact, rest, release. Each leaves the flank marked as touched:
!> what the tooth does there next is decided and is not asked again. The reset map, which turns the
!> velocity of arrival into that of rebound, is the contact law's: contact/impact.f90.
module lapwing_hybrid_impact
  use lapwing_kinds, only: wp
  use lapwing_hybrid_chatter, only: below_resolution
  use lapwing_codes, only: separation, drive_flank, event_impact, event_release, event_engage, &
      event_chatter_end, event_kind
  use lapwing_hybrid_state, only: hybrid_state_t, segment_t
  use lapwing_polynomial_evaluation, only: max_degree
  use lapwing_polynomial_roots, only: first_nonzero
  use lapwing_system, only: system_t, frame_t, approach_velocity, max_states
  implicit none
  private
  public :: arrive, pass_kink_in_contact, begin_contact, release, pressing_sign, log_event

  !> A rebound slower than this part of a period times the strongest pressing acceleration might be
  !> below the resolution of time; of those, twice as many as can be.
  real(wp), parameter :: slow_part = 4*epsilon(1.0_wp)

contains

  !> A tooth in separation has arrived at a flank: the state is there, its approach undecided.
  subroutine arrive(system, state, segment, flank, flank_velocity)
    class(system_t), intent(in) :: system           !! what moves
    type(hybrid_state_t), intent(inout) :: state
    type(segment_t), intent(inout) :: segment       !! what happened
    integer, intent(in) :: flank                    !! flank met
    real(wp), intent(in) :: flank_velocity          !! its own, where the law asks for it
    real(wp) :: before, after
    logical :: impact
    state%instant%chart = flank
    state%instant%touching = flank
    before = approach_velocity(flank, state%instant%y)
    if (before < 0) then
      ! Grazed to the last bits: it is leaving already.
      call system%place_at_flank(flank, before, state%instant%y)
      return
    end if
    call system%law%reset(merge(flank_velocity, -flank_velocity, flank == drive_flank), before, &
        after, impact)
    if (.not. impact) then
      call begin_contact(system, state, segment, event_engage, flank, after)
      return
    end if
    call system%place_at_flank(flank, after, state%instant%y)
    call log_event(system, state, segment, event_impact, flank, before, after)
    if (flank == drive_flank) state%fastest = max(state%fastest, state%leaving)
    state%leaving = merge(max(-after, 0.0_wp), 0.0_wp, flank == drive_flank)
    if (abs(after) <= slow_part*system%period*system%strongest) then
      call rest_or_leave(system, state, segment, flank, after)
    else if (after > 0) then
      call begin_contact(system, state, segment, event_engage, flank, after)
    end if
  end subroutine arrive

  !> After an impact that leaves hardly any speed: the tooth goes on into the flank, or rests on it
  !> if pressed, or leaves.
  subroutine rest_or_leave(system, state, segment, flank, after)
    class(system_t), intent(in) :: system           !! what moves
    type(hybrid_state_t), intent(inout) :: state
    type(segment_t), intent(inout) :: segment       !! what happened
    integer, intent(in) :: flank                    !! flank met
    real(wp), intent(in) :: after                   !! approach velocity after the impact
    type(frame_t) :: frame
    real(wp) :: pressing(0:max_degree)
    call system%open_frame(state%instant, frame)
    if (after > 0) then
      call begin_contact(system, state, segment, event_engage, flank, after)
    else if (after < 0) then
      call system%pressing(frame, flank, 0.0_wp, state%instant%y, pressing)
      if (below_resolution(pressing(0), -after, system%period)) then
        call begin_contact(system, state, segment, event_chatter_end, flank, 0.0_wp)
      end if
    else if (pressing_sign(system, frame, flank, 0.0_wp, state%instant%y) > 0) then
      call begin_contact(system, state, segment, event_engage, flank, 0.0_wp)
    end if
  end subroutine rest_or_leave

  !> A kink under a tooth in rigid contact: an impact where the flank turns towards it, release
  !> where it turns away. The state is just past the kink.
  subroutine pass_kink_in_contact(system, state, segment)
    class(system_t), intent(in) :: system           !! what moves
    type(hybrid_state_t), intent(inout) :: state
    type(segment_t), intent(inout) :: segment       !! what happened
    type(frame_t) :: frame
    real(wp) :: before, after, flank_velocity
    integer :: flank
    logical :: impact
    flank = state%instant%motion_state
    state%instant%touching = flank
    call system%open_frame(state%instant, frame)
    before = approach_velocity(flank, state%instant%y)
    if (before > 0) then
      flank_velocity = system%flank_velocity(frame, flank, 0.0_wp)
      call system%law%reset(merge(flank_velocity, -flank_velocity, flank == drive_flank), before, &
          after, impact)
      call system%place_at_flank(flank, after, state%instant%y)
      call log_event(system, state, segment, event_impact, flank, before, after)
      if (after < 0 .or. pressing_sign(system, frame, flank, 0.0_wp, state%instant%y) < 0) then
        call release(system, state, segment, flank, after)
      end if
    else if (before < 0) then
      call release(system, state, segment, flank, before)
    end if
  end subroutine pass_kink_in_contact

  !> Contact begins with an approach velocity of zero or more.
  subroutine begin_contact(system, state, segment, kind, flank, approach)
    class(system_t), intent(in) :: system           !! what moves
    type(hybrid_state_t), intent(inout) :: state
    type(segment_t), intent(inout) :: segment       !! what happened
    integer, intent(in) :: kind                     !! event_engage or event_chatter_end
    integer, intent(in) :: flank
    real(wp), intent(in) :: approach                !! approach velocity
    call system%place_at_flank(flank, approach, state%instant%y)
    state%instant%motion_state = flank
    state%instant%touching = flank
    state%leaving = 0
    call log_event(system, state, segment, kind, flank, approach, approach)
  end subroutine begin_contact

  !> Contact ends; no restitution applies.
  subroutine release(system, state, segment, flank, approach)
    class(system_t), intent(in) :: system           !! what moves
    type(hybrid_state_t), intent(inout) :: state
    type(segment_t), intent(inout) :: segment       !! what happened
    integer, intent(in) :: flank                    !! flank left
    real(wp), intent(in) :: approach                !! approach velocity, not positive
    call system%place_at_flank(flank, approach, state%instant%y)
    state%instant%motion_state = separation
    state%instant%touching = flank
    state%leaving = 0
    call log_event(system, state, segment, event_release, flank, approach, approach)
  end subroutine release

  !> Sign of the first derivative of the pressing acceleration that does not vanish at s: whether
  !> a tooth at rest on the flank stays (+1), leaves (-1) or is left where it is (0).
  pure real(wp) function pressing_sign(system, frame, flank, s, z)
    class(system_t), intent(in) :: system           !! what moves
    type(frame_t), intent(in) :: frame              !! frame on the piece that holds s
    integer, intent(in) :: flank
    real(wp), intent(in) :: s                       !! time since the frame was opened
    real(wp), intent(in) :: z(max_states)           !! local coordinates at s
    real(wp) :: c(0:max_degree), leading
    call system%pressing(frame, flank, s, z, c)
    leading = first_nonzero(c)
    pressing_sign = merge(0.0_wp, sign(1.0_wp, leading), leading == 0)
  end function pressing_sign

  !> Add a line to the segment's events.
  subroutine log_event(system, state, segment, kind, flank, approach_before, approach_after)
    class(system_t), intent(in) :: system           !! what moves
    type(hybrid_state_t), intent(in) :: state       !! state after the event
    type(segment_t), intent(inout) :: segment       !! what happened
    integer, intent(in) :: kind                     !! kind at the drive flank
    integer, intent(in) :: flank
    real(wp), intent(in) :: approach_before         !! approach velocity before
    real(wp), intent(in) :: approach_after          !! and after
    real(wp) :: phi_dot, direction
    direction = merge(1.0_wp, -1.0_wp, flank == drive_flank)
    segment%n_events = segment%n_events + 1
    associate (event => segment%events(segment%n_events))
      event%kind = event_kind(kind, flank)
      event%cycle = state%instant%cycle
      event%t = state%instant%t
      event%before = direction*approach_before
      event%after = direction*approach_after
      call system%observe(state%instant, event%phi, phi_dot)
    end associate
  end subroutine log_event
end module lapwing_hybrid_impact
