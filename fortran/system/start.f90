!> Where a run of the oscillator can begin.
module lapwing_system_start
  use lapwing_kinds, only: wp
  use lapwing_codes, only: separation, engagement, back_engagement, coast_flank
  use lapwing_system_oscillator, only: oscillator_t
  use lapwing_system, only: instant_t
  use lapwing_flank, only: locate_piece
  implicit none
  private
  public :: start_of_run, start_at_rest, start_from

contains

  !> Where a run begins: at rest, or in a motion state with phi and phi'.
  function start_of_run(self, start) result(instant)
    class(oscillator_t), intent(in) :: self  !! oscillator
    real(wp), intent(in) :: start(4)         !! negative: `rest`, or motion state; phi, phi'; phase
    type(instant_t) :: instant
    if (start(1) >= 0) then
      instant = start_from(self, start(4), nint(start(1)), start(2), start(3))
    else
      instant = start_at_rest(self, start(4))
    end if
  end function start_of_run

  !> Start `rest`: the tooth rests on the flank that F presses it to, moving with it. A negative F
  !> wants a coast flank.
  function start_at_rest(self, phase) result(instant)
    class(oscillator_t), intent(in) :: self  !! oscillator
    real(wp), intent(in) :: phase            !! mesh phase, periods
    type(instant_t) :: instant
    real(wp) :: deflection
    instant%t = phase*self%period
    instant%piece = locate_piece(self%path, instant%t, 1)
    deflection = merge(0.0_wp, self%force, self%law%is_rigid())
    instant%y(1:2) = [deflection, 0.0_wp]
    instant%motion_state = engagement
    if (self%force < 0) then
      instant%motion_state = back_engagement
      instant%chart = coast_flank
    end if
  end function start_at_rest

  !> Start from a motion state, phi and phi'.
  function start_from(self, phase, motion_state, phi, phi_dot) result(instant)
    class(oscillator_t), intent(in) :: self    !! oscillator
    real(wp), intent(in) :: phase              !! mesh phase, periods
    integer, intent(in) :: motion_state        !! separation, engagement or back_engagement
    real(wp), intent(in) :: phi, phi_dot       !! rad, rad per tau
    type(instant_t) :: instant
    real(wp) :: g, slope
    instant%t = phase*self%period
    instant%piece = locate_piece(self%path, instant%t, 1)
    instant%motion_state = motion_state
    instant%y(1:2) = [phi, phi_dot]
    if (motion_state == back_engagement) then
      instant%chart = coast_flank
      instant%y(1) = phi + self%width
      if (.not. self%moves(coast_flank)) then
        call self%path%motion(instant%t, instant%piece, g, slope)
        instant%y(1:2) = instant%y(1:2) + [g, slope]
      end if
    end if
    if (self%law%is_rigid() .and. motion_state /= separation) instant%y(1:2) = 0
  end function start_from
end module lapwing_system_start
