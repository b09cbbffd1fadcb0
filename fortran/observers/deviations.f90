!> How small deviations move between events: by exp(A s), A the derivatives of the rates by the
!> states. A system that is linear in each motion state has one A for each.
!>
!> States 1 and 2 are the distance to a flank and its rate. Where they are a damped oscillator of
!> unit frequency that no other state has a part in, their closed form stands for the exponential.
module lapwing_observers_deviations
  use lapwing_kinds, only: wp
  use lapwing_codes, only: separation, back_engagement
  use lapwing_system_oscillation, only: damped_t, damped, free_matrix
  use lapwing_system, only: system_t, frame_t, max_states
  implicit none
  private
  public :: deviations_t, deviations_of, move_deviations, change_tooth, exponential

  !> Of one system.
  type :: deviations_t
    integer :: n = 2                                                !! states
    real(wp) :: a(max_states, max_states, separation:back_engagement) = 0   !! A by motion state
    real(wp) :: divergence(separation:back_engagement) = 0          !! its trace
    logical :: drifts(separation:back_engagement) = .false.         !! whether A*A = 0
    logical :: oscillates(separation:back_engagement) = .false.     !! whether states 1 and 2 are
    type(damped_t) :: contact                                       !! this oscillator
  end type deviations_t

contains

  !> Deviations of a system.
  function deviations_of(system) result(self)
    class(system_t), intent(in) :: system        !! what moves
    type(deviations_t) :: self
    integer :: state, i
    self%n = system%n_states
    do state = separation, back_engagement
      associate (n => self%n, a => self%a(:, :, state))
        call find_jacobian(system, state, a(:n, :n))
        do i = 1, n
          self%divergence(state) = self%divergence(state) + a(i, i)
        end do
        self%drifts(state) = all(product_of(a(:n, :n), a(:n, :n)) == 0)
        self%oscillates(state) = all(a(1, :2) == [0, 1]) .and. a(2, 1) == -1 .and. a(2, 2) <= 0 &
            .and. all(a(:2, 3:n) == 0) .and. all(a(3:n, :2) == 0)
        if (self%oscillates(state)) self%contact = damped(-0.5_wp*a(2, 2))
      end associate
    end do
  end function deviations_of

  !> Derivatives of the rates by the states in a motion state: of a system that is linear in each of
  !> them, and whose coefficients do not change with time. In a state so large the rest of the rates
  !> rounds away, and what is left has all its digits.
  pure subroutine find_jacobian(system, motion_state, a)
    class(system_t), intent(in) :: system             !! what moves
    integer, intent(in) :: motion_state               !! motion state
    real(wp), intent(out) :: a(:, :)                  !! (n, n)
    real(wp), parameter :: large = 2.0_wp**200
    type(frame_t) :: frame
    real(wp), dimension(size(a, 1)) :: z, rate, rest
    integer :: i
    if (motion_state /= separation) frame%chart = motion_state
    z = 0
    call system%derivatives(frame, motion_state, 0.0_wp, z, rest)
    do i = 1, size(z)
      z(i) = large
      call system%derivatives(frame, motion_state, 0.0_wp, z, rate)
      a(:, i) = (rate - rest)/large
      z(i) = 0
    end do
  end subroutine find_jacobian

  !> Move deviations, the first columns of a matrix, over a time s of one motion state.
  pure subroutine move_deviations(self, motion_state, s, m)
    type(deviations_t), intent(in) :: self
    integer, intent(in) :: motion_state               !! motion state
    real(wp), intent(in) :: s                         !! time, not negative
    real(wp), intent(inout) :: m(max_states, self%n)  !! deviations
    integer :: k
    associate (a => self%a(:, :, motion_state), n => self%n)
      if (self%drifts(motion_state)) then
        do k = 1, n
          m(:n, k) = m(:n, k) + s*times(n, a, m(:, k))
        end do
      else if (self%oscillates(motion_state)) then
        call change_tooth(free_matrix(self%contact, s), n, m)
        if (n > 2) m(3:n, :) = product_of(exponential(a(3:n, 3:n), s), m(3:n, :))
      else
        m(:n, :) = product_of(exponential(a(:n, :n), s), m(:n, :))
      end if
    end associate
  end subroutine move_deviations

  !> A x.
  pure function times(n, a, x) result(y)
    integer, intent(in) :: n                          !! states in use
    real(wp), intent(in) :: a(max_states, n)          !! A
    real(wp), intent(in) :: x(max_states)             !! x
    real(wp) :: y(n)
    integer :: i
    y = a(:n, 1)*x(1)
    do i = 2, n
      y = y + a(:n, i)*x(i)
    end do
  end function times

  !> A factor that changes states 1 and 2 of deviations and no other.
  pure subroutine change_tooth(factor, n, m)
    real(wp), intent(in) :: factor(2, 2)              !! matrix
    integer, intent(in) :: n                          !! deviations
    real(wp), intent(inout) :: m(max_states, n)       !! deviations
    integer :: k
    do k = 1, n
      m(:2, k) = factor(:, 1)*m(1, k) + factor(:, 2)*m(2, k)
    end do
  end subroutine change_tooth

  !> exp(A s). Uniform motion, A*A = 0, is exact; else the Taylor series of a part of s, squared as
  !> often as it was halved.
  pure function exponential(a, s) result(e)
    real(wp), intent(in) :: a(:, :)              !! A, square
    real(wp), intent(in) :: s                    !! time
    real(wp) :: e(size(a, 1), size(a, 1)), term(size(a, 1), size(a, 1)), part
    integer :: i, halvings, order
    !> Terms of the series: 2**-16/16! is below the last digit.
    integer, parameter :: most_terms = 16
    halvings = 0
    if (any(product_of(a, a) /= 0)) then
      halvings = max(0, exponent(maxval(sum(abs(a), dim=2))*abs(s)) + 1)
    end if
    part = scale(s, -halvings)
    e = 0
    do i = 1, size(a, 1)
      e(i, i) = 1
    end do
    term = e
    do order = 1, most_terms
      term = product_of(a, term)*(part/order)
      if (all(term == 0)) exit
      e = e + term
    end do
    do i = 1, halvings
      e = product_of(e, e)
    end do
  end function exponential

  !> A B. The library's `matmul` sums in another way on another processor.
  pure function product_of(a, b) result(c)
    real(wp), intent(in) :: a(:, :), b(:, :)     !! A, square, and B
    real(wp) :: c(size(a, 1), size(b, 2))
    integer :: i, j, k
    do j = 1, size(b, 2)
      do i = 1, size(a, 1)
        c(i, j) = a(i, 1)*b(1, j)
        do k = 2, size(a, 1)
          c(i, j) = c(i, j) + a(i, k)*b(k, j)
        end do
      end do
    end do
  end function product_of
end module lapwing_observers_deviations
