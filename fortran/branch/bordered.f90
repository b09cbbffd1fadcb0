!> Equations that link each event with the one before, round a repetition, with one column and one
!> row more: orthogonal elimination event by event, as stable as a full factorisation and linear in
!> the number of events (S. J. Wright, SIAM J. Sci. Stat. Comput. 13 (1992) 742-764).
module lapwing_branch_bordered
  use, intrinsic :: ieee_arithmetic, only: ieee_value, ieee_quiet_nan
  use lapwing_kinds, only: wp
  implicit none
  private
  public :: solve_bordered, once_round

  !> Columns of the rows that are worked on: this event's unknowns, the last event's, the next
  !> one's, the parameter, the right side.
  integer, parameter :: this = 1, last = 3, next = 5, value = 7, right_side = 8

contains

  !> Solution of one(j) x(j-1) + two(j) x(j) + column(j) p = right(j), row (x, p) = the last of
  !> `right`; not numbers where there is none.
  subroutine solve_bordered(one, two, column, row, right, kept, solution)
    real(wp), contiguous, intent(in) :: one(:, :, :), two(:, :, :)   !! (2, 2, n)
    real(wp), contiguous, intent(in) :: column(:), row(:), right(:)  !! (2 n), (2 n + 1) twice
    real(wp), contiguous, intent(inout) :: kept(:, :, :)             !! (2, 8, n), work
    real(wp), contiguous, intent(inout) :: solution(:)               !! (2 n + 1)
    real(wp) :: rows(4, 8), border(8), y(2), final(3, 4), ends(3)
    integer :: n, j
    n = size(one, 3)
    border = 0
    border(last:last + 1) = row(2*n - 1:2*n)
    border(value) = row(2*n + 1)
    border(right_side) = right(2*n + 1)
    rows = 0
    rows(1:2, last:last + 1) = one(:, :, 1)
    rows(1:2, this:this + 1) = two(:, :, 1)
    rows(1:2, value) = column(1:2)
    rows(1:2, right_side) = right(1:2)
    do j = 1, n - 1
      rows(3:4, this:this + 1) = one(:, :, j + 1)
      rows(3:4, last:last + 1) = 0
      rows(1:2, next:next + 1) = 0
      rows(3:4, next:next + 1) = two(:, :, j + 1)
      rows(3:4, value) = column(2*j + 1:2*j + 2)
      rows(3:4, right_side) = right(2*j + 1:2*j + 2)
      call triangular(rows)
      kept(:, :, j) = rows(1:2, :)
      ! The row's part in this event's unknowns goes over to the others.
      border(this:this + 1) = border(next:next + 1) + row(2*j - 1:2*j)
      border(next:next + 1) = 0
      y(1) = border(this)/rows(1, 1)
      y(2) = (border(this + 1) - y(1)*rows(1, 2))/rows(2, 2)
      border(last:) = border(last:) - y(1)*rows(1, last:) - y(2)*rows(2, last:)
      rows(1:2, :) = rows(3:4, :)
      rows(1:2, this:this + 1) = rows(3:4, next:next + 1)
    end do
    final(1:2, 1:2) = rows(1:2, last:last + 1) + rows(1:2, this:this + 1)
    final(1:2, 3) = rows(1:2, value)
    final(1:2, 4) = rows(1:2, right_side)
    final(3, :) = [border(last:last + 1) + border(next:next + 1), border(value), border(right_side)]
    call solve_three(final, ends)
    solution(2*n - 1:2*n + 1) = ends
    do j = n - 1, 1, -1
      associate (k => kept(:, :, j))
        y = k(:, right_side) - matmul(k(:, last:last + 1), ends(1:2)) - k(:, value)*ends(3) &
            - matmul(k(:, next:next + 1), solution(2*j + 1:2*j + 2))
        solution(2*j) = y(2)/k(2, 2)
        solution(2*j - 1) = (y(1) - k(1, 2)*solution(2*j))/k(1, 1)
      end associate
    end do
  end subroutine solve_bordered

  !> Two reflections that bring the first two columns of four rows to a triangle.
  pure subroutine triangular(rows)
    real(wp), intent(inout) :: rows(4, 8)          !! the rows
    real(wp) :: v(4), size_of, factor
    integer :: k, column
    do k = 1, 2
      v = 0
      v(k:) = rows(k:, k)
      size_of = norm2(v)
      if (.not. size_of > 0) cycle
      v(k) = v(k) + sign(size_of, v(k))
      factor = 2/dot_product(v, v)
      do column = k, 8
        rows(:, column) = rows(:, column) - factor*dot_product(v, rows(:, column))*v
      end do
    end do
  end subroutine triangular

  !> Three equations by elimination with pivots.
  pure subroutine solve_three(a, x)
    real(wp), intent(inout) :: a(3, 4)             !! matrix and right side
    real(wp), intent(out) :: x(3)                  !! solution
    real(wp) :: swap(4)
    integer :: k, j, best
    do k = 1, 2
      best = k - 1 + maxloc(abs(a(k:, k)), 1)
      swap = a(k, :)
      a(k, :) = a(best, :)
      a(best, :) = swap
      do j = k + 1, 3
        a(j, k:) = a(j, k:) - a(j, k)/a(k, k)*a(k, k:)
      end do
    end do
    x(3) = a(3, 4)/a(3, 3)
    x(2) = (a(2, 4) - a(2, 3)*x(3))/a(2, 2)
    x(1) = (a(1, 4) - a(1, 2)*x(2) - a(1, 3)*x(3))/a(1, 1)
  end subroutine solve_three

  !> Trace and determinant of the map of a deviation once round, and its rank; not numbers where
  !> an event does not follow from the one before.
  subroutine once_round(one, two, trace, det, rank)
    real(wp), contiguous, intent(in) :: one(:, :, :), two(:, :, :)   !! (2, 2, n)
    real(wp), intent(out) :: trace, det            !! of the map
    integer, intent(out) :: rank                   !! of the map
    real(wp) :: m(2, 2), step(2, 2), of_two, of_one, log_det, sign_of, size_of
    integer :: j, shift, power
    m = reshape([1.0_wp, 0.0_wp, 0.0_wp, 1.0_wp], [2, 2])
    log_det = 0
    sign_of = 1
    rank = 2
    power = 0
    do j = 1, size(one, 3)
      associate (a => one(:, :, j), b => two(:, :, j))
        of_two = b(1, 1)*b(2, 2) - b(1, 2)*b(2, 1)
        of_one = a(1, 1)*a(2, 2) - a(1, 2)*a(2, 1)
        if (of_two == 0) then
          trace = ieee_value(trace, ieee_quiet_nan)
          det = trace
          return
        end if
        step(1, :) = (b(1, 2)*a(2, :) - b(2, 2)*a(1, :))/of_two
        step(2, :) = (b(2, 1)*a(1, :) - b(1, 1)*a(2, :))/of_two
      end associate
      m = matmul(step, m)
      size_of = maxval(abs(m))
      if (.not. size_of > 0) then
        trace = size_of
        det = size_of
        rank = 0
        return
      end if
      shift = exponent(size_of)
      m = scale(m, -shift)
      power = power + shift
      if (of_one == 0) then
        rank = 1
      else
        log_det = log_det + log(abs(of_one/of_two))
        sign_of = sign_of*sign(1.0_wp, of_one/of_two)
      end if
    end do
    trace = (m(1, 1) + m(2, 2))*2.0_wp**power
    det = merge(sign_of*exp(log_det), 0.0_wp, rank == 2)
  end subroutine once_round

end module lapwing_branch_bordered
