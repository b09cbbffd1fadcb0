!> The step formula: one fourth-order Runge-Kutta step, its dense output and its error estimate.
module lapwing_rk4
  use lapwing_kinds, only: wp
  use lapwing_system, only: system_t, frame_t, motion_t, max_states
  use lapwing_rk4_tableau, only: n_stages, b3, b4, b5, dense_weight
  implicit none
  private
  public :: rk4_step, rk4_move

  !> sigma**2 (1 - sigma)**2 is at most 1/16 on the step (see `rk4_step`).
  real(wp), parameter :: largest_bump = 1.0_wp/16
  !> An estimate below the rounding of its own sum (weights up to 5, six terms) says nothing: in a
  !> flight, where the formula is exact, it would otherwise shorten the steps.
  real(wp), parameter :: rounding = 16*epsilon(1.0_wp)

contains

  !> One step of length h with dense output.
  !>
  !> The error estimate is the largest distance, over the step, between the quartic dense output
  !> and the cubic with the same values and slopes at both ends: |dense(4)|/16. As a formula at
  !> the end of the step it is an embedded one of third order, b - w_4/16 with w_4 the weights of
  !> (s/h)**4, so that it falls as h**4 and the global error as the tolerance itself.
  subroutine rk4_step(system, frame, motion_state, h, z, motion, z_end, error)
    class(system_t), intent(in) :: system         !! what moves
    type(frame_t), intent(in) :: frame            !! frame as opened
    integer, intent(in) :: motion_state           !! motion state
    real(wp), intent(in) :: h                     !! step
    real(wp), intent(in) :: z(max_states)         !! local coordinates at s = 0
    type(motion_t), intent(inout) :: motion       !! the step as a polynomial
    real(wp), intent(out) :: z_end(max_states)    !! local coordinates at s = h
    real(wp), intent(out) :: error(max_states)    !! estimated error of each coordinate
    real(wp) :: k(max_states, n_stages), change(2:n_stages)
    integer :: i, n
    n = system%n_states
    call system%stages(frame, motion_state, h, z, k)
    motion%h = h
    do i = 1, n
      change = k(i, 2:) - k(i, 1)
      motion%dense(0, i) = z(i)
      motion%dense(1, i) = h*k(i, 1)
      motion%dense(2, i) = h*weighted(change, dense_weight(:, 2))
      motion%dense(3, i) = h*weighted(change, dense_weight(:, 3))
      motion%dense(4, i) = h*weighted(change, dense_weight(:, 4))
      z_end(i) = end_value(z(i), h, k(i, 1), change)
      error(i) = largest_bump*abs(motion%dense(4, i))
      if (error(i) <= largest_bump*rounding*h*maxval(abs(change))) error(i) = 0
    end do
  end subroutine rk4_step

  !> Where a step of length h ends, and nothing else.
  subroutine rk4_move(system, frame, motion_state, h, z, z_end)
    class(system_t), intent(in) :: system         !! what moves
    type(frame_t), intent(in) :: frame            !! frame as opened
    integer, intent(in) :: motion_state           !! motion state
    real(wp), intent(in) :: h                     !! step
    real(wp), intent(in) :: z(max_states)         !! local coordinates at s = 0
    real(wp), intent(out) :: z_end(max_states)    !! local coordinates at s = h
    real(wp) :: k(max_states, n_stages), change(2:n_stages)
    integer :: i
    call system%stages(frame, motion_state, h, z, k)
    do i = 1, system%n_states
      change = k(i, 2:) - k(i, 1)
      z_end(i) = end_value(z(i), h, k(i, 1), change)
    end do
  end subroutine rk4_move

  !> The fourth-order formula, about the first stage: where the derivative is constant it is exact,
  !> and no rounding of the weights adds up over many steps.
  pure real(wp) function end_value(z, h, first, change)
    real(wp), intent(in) :: z                    !! coordinate at the beginning
    real(wp), intent(in) :: h                    !! step
    real(wp), intent(in) :: first                !! first stage's derivative
    real(wp), intent(in) :: change(2:n_stages)   !! the others' difference from it
    end_value = z + h*(first + (b3*change(3) + b4*change(4) + b5*change(5)))
  end function end_value

  !> Sum over the stages; the weights sum to zero, and the second has none.
  pure real(wp) function weighted(change, w)
    real(wp), intent(in) :: change(2:n_stages)   !! stage derivatives less the first
    real(wp), intent(in) :: w(n_stages)          !! weights
    weighted = w(3)*change(3) + w(4)*change(4) + w(5)*change(5) + w(6)*change(6)
  end function weighted
end module lapwing_rk4
