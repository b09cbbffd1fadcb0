!> The end of a complete chatter (Zeno): infinitely many impacts in finite time, summed. When it may
!> be, and what then becomes of the state: `sum_chatter` of hybrid/automaton.f90.
module lapwing_hybrid_chatter
  use lapwing_kinds, only: wp
  use lapwing_polynomial_evaluation, only: max_degree
  use lapwing_polynomial_roots, only: first_zero
  implicit none
  private
  public :: remaining_chatter, below_resolution, listed_down_to, summed_up_to

  !> Bounces are followed one by one, and listed, while the rest of the chatter lasts longer than
  !> this part of the mesh period.
  real(wp), parameter :: listed_down_to = 1.0e-7_wp
  !> Where no one asks for single bounces, those that do not count are summed as soon as the sum is
  !> right to the tolerance, which is not looked at before the rest lasts less than this part.
  real(wp), parameter :: summed_up_to = 1.0e-4_wp
  !> ... and what the sum neglects is less than this part of the rest.
  real(wp), parameter :: alike = 0.01_wp
  !> Units in the last place of time below which a flight is no flight.
  real(wp), parameter :: resolution_ulps = 4

contains

  !> Whether the chatter that follows an impact may be summed, and how long it lasts.
  !>
  !> With pressing acceleration a + j s + k s**2 + ..., rebound speed v, r = 2|j|v/(3a**2(1-eps)):
  !> T1 = 2v/(a(1-eps)) sums the bounces under constant a, the jerk corrects it to
  !> T = T1 - 4 j v**2/(3 a**3 (1-eps)**2), and what that neglects is about
  !> T1 (r**2 + |2k| v**2/(a**3 (1-eps)**2)). Only T1 decides whether a chatter is short: far
  !> from its end the corrected duration may even be negative.
  pure subroutine remaining_chatter(pressing, speed, restitution, period, longest, tolerance, &
      free, ends, duration)
    real(wp), intent(in) :: pressing(0:max_degree)  !! pressing acceleration about the impact
    real(wp), intent(in) :: speed                   !! v, separation speed after the impact
    real(wp), intent(in) :: restitution             !! eps
    real(wp), intent(in) :: period                  !! mesh period
    real(wp), intent(in) :: longest                 !! rest that may be summed, in mesh periods
    real(wp), intent(in) :: tolerance               !! of the duration, in mesh periods
    real(wp), intent(in) :: free                    !! time to the next knot
    logical, intent(out) :: ends                    !! whether it may be summed
    real(wp), intent(out) :: duration               !! time to the end of the chatter
    real(wp) :: a, j, loss, first, r, neglected, zero_at
    logical :: released
    ends = .false.
    duration = 0
    a = pressing(0)
    j = pressing(1)
    loss = 1 - restitution
    if (.not. (a > 0 .and. loss > 0 .and. speed > 0)) return
    first = 2*speed/(a*loss)
    if (first > longest*period) return
    r = 2*abs(j)*speed/(3*a**2*loss)
    neglected = first*(r**2 + 2*abs(pressing(2))*speed**2/(a**3*loss**2))
    duration = first - 4*j*speed**2/(3*a**3*loss**2)
    if (neglected > tolerance*period .or. duration <= 0) return
    ! Of what is summed early the pressing is all but constant, however wide the tolerance is.
    if (first > listed_down_to*period .and. neglected > alike*first) return
    if (2*first >= free - spacing(period)) return
    call first_zero(pressing, 2*first, released, zero_at)
    ends = .not. released
  end subroutine remaining_chatter

  !> Whether rebound and next flight are below the resolution of time: a tooth that is pressed then
  !> rests.
  pure logical function below_resolution(pressing, speed, period)
    real(wp), intent(in) :: pressing   !! pressing acceleration at the impact
    real(wp), intent(in) :: speed      !! separation speed after it
    real(wp), intent(in) :: period     !! mesh period
    below_resolution = pressing > 0 &
        .and. 2*speed <= pressing*resolution_ulps*spacing(period)
  end function below_resolution
end module lapwing_hybrid_chatter
