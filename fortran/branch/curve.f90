!> A flank and the engaged response to it at mesh phases, each on a piece that is named: a phase
!> that comes to the end of its piece is followed a little beyond, on the same polynomial.
module lapwing_branch_curve
  use lapwing_kinds, only: wp
  implicit none
  private
  public :: curve_t, curve_of, piece_at, piece_begin, derivatives, response, rise

  real(wp), parameter :: two_pi = 6.283185307179586477_wp
  !> 1/k!, by which g and its derivatives are powers of time
  real(wp), parameter :: over_factorial(2:5) = [1/2.0_wp, 1/6.0_wp, 1/24.0_wp, 1/120.0_wp]
  integer, parameter :: most_pieces_crossed = 100000

  !> Pieces of polynomials, or a harmonic series; pointers to the caller's arrays.
  type :: curve_t
    integer :: pieces = 0                                        !! in a mesh period; 0: a series
    real(wp) :: period = 1                                       !! mesh period, tau
    real(wp), pointer, contiguous :: knots(:) => null()          !! phases, pieces + 1
    real(wp), pointer, contiguous :: g(:, :, :) => null()        !! (6, powers, pieces)
    real(wp), pointer, contiguous :: edges(:) => null()          !! phases of the response's steps
    real(wp), pointer, contiguous :: q(:, :, :) => null()        !! (2, powers, steps)
    real(wp), pointer, contiguous :: first(:) => null()          !! first step of each piece; one
                                                                 !! number: steps cross pieces
    real(wp), pointer, contiguous :: terms(:, :) => null()       !! (5, terms) order; g and q as
                                                                 !! real and imaginary parts
  end type curve_t

contains

  function curve_of(period, knots, g, edges, q, first, terms) result(self)
    real(wp), intent(in) :: period                               !! mesh period, tau
    real(wp), contiguous, target, intent(in) :: knots(:)         !! the components of `curve_t`;
    real(wp), contiguous, target, intent(in) :: g(:, :, :)       !! of a series one knot
    real(wp), contiguous, target, intent(in) :: edges(:)         !! edges of the response
    real(wp), contiguous, target, intent(in) :: q(:, :, :)       !! the response
    real(wp), contiguous, target, intent(in) :: first(:)         !! first steps
    real(wp), contiguous, target, intent(in) :: terms(:, :)      !! the series
    type(curve_t) :: self
    self%pieces = size(knots) - 1
    self%period = period
    self%knots => knots
    self%g => g
    self%edges => edges
    self%q => q
    self%first => first
    self%terms => terms
  end function curve_of

  !> Piece on which a phase lies (right limit), counted from that which begins at phase 0.
  pure integer function piece_at(self, phase) result(piece)
    type(curve_t), intent(in) :: self  !! flank
    real(wp), intent(in) :: phase      !! mesh periods
    integer :: turn, low, high, middle
    piece = 0
    if (self%pieces == 0) return
    turn = floor(phase)
    low = 1
    high = self%pieces + 1
    do while (high - low > 1)
      middle = (low + high)/2
      if (phase - turn >= self%knots(middle)) then
        low = middle
      else
        high = middle
      end if
    end do
    piece = low - 1 + turn*self%pieces
  end function piece_at

  !> Phase at which a piece begins.
  pure real(wp) function piece_begin(self, piece) result(phase)
    type(curve_t), intent(in) :: self  !! flank, no series
    integer, intent(in) :: piece       !! its number
    integer :: own
    own = modulo(piece, self%pieces)
    phase = self%knots(own + 1) + (piece - own)/self%pieces
  end function piece_begin

  !> g, g', ... to the fifth, by tau.
  pure function derivatives(self, phase, piece) result(d)
    type(curve_t), intent(in) :: self  !! flank
    real(wp), intent(in) :: phase      !! mesh periods
    integer, intent(in) :: piece       !! its piece
    real(wp) :: d(0:5), x
    complex(wp) :: turned
    integer :: own, k, j
    if (self%pieces == 0) then
      d = 0
      do j = 1, size(self%terms, 2)
        turned = turned_term(self, j, phase)
        do k = 0, 5
          d(k) = d(k) + real(turned, wp)
          turned = turned*cmplx(0, self%terms(1, j)*two_pi/self%period, wp)
        end do
      end do
      return
    end if
    own = modulo(piece, self%pieces) + 1
    x = phase - piece_begin(self, piece)
    d = self%g(:, size(self%g, 2), own)
    do k = size(self%g, 2) - 1, 1, -1
      d = d*x + self%g(:, k, own)
    end do
  end function derivatives

  pure complex(wp) function turned_term(self, j, phase) result(turned)
    type(curve_t), intent(in) :: self  !! a series
    integer, intent(in) :: j           !! which term
    real(wp), intent(in) :: phase      !! mesh periods
    real(wp) :: angle
    angle = two_pi*self%terms(1, j)*modulo(phase, 1.0_wp)
    turned = cmplx(cos(angle), sin(angle), wp)*cmplx(self%terms(2, j), self%terms(3, j), wp)
  end function turned_term

  !> q and q' of q'' + 2 xi q' + q = -g''.
  pure function response(self, phase, piece) result(q)
    type(curve_t), intent(in) :: self  !! flank
    real(wp), intent(in) :: phase      !! mesh periods
    integer, intent(in) :: piece       !! its piece
    real(wp) :: q(2), x, angle
    complex(wp) :: turned
    integer :: own, low, high, middle, k, j
    if (self%pieces == 0) then
      q = 0
      do j = 1, size(self%terms, 2)
        angle = two_pi*self%terms(1, j)*modulo(phase, 1.0_wp)
        turned = cmplx(cos(angle), sin(angle), wp)*cmplx(self%terms(4, j), self%terms(5, j), wp)
        q(1) = q(1) + real(turned, wp)
        q(2) = q(2) + real(turned*cmplx(0, self%terms(1, j)*two_pi/self%period, wp), wp)
      end do
      return
    end if
    low = 1
    high = size(self%edges)
    x = modulo(phase, 1.0_wp)
    if (size(self%first) > 1) then
      own = modulo(piece, self%pieces) + 1
      low = nint(self%first(own)) + 1
      high = nint(self%first(own + 1)) + 1
      x = phase - piece_begin(self, piece) + self%knots(own)
    end if
    do while (high - low > 1)
      middle = (low + high)/2
      if (x >= self%edges(middle)) then
        low = middle
      else
        high = middle
      end if
    end do
    x = (x - self%edges(low))/(self%edges(low + 1) - self%edges(low))
    q = self%q(:, size(self%q, 2), low)
    do k = size(self%q, 2) - 1, 1, -1
      q = q*x + self%q(:, k, low)
    end do
    q(2) = q(2)/((self%edges(low + 1) - self%edges(low))*self%period)
  end function response

  !> (g(t + s) - g(t) - g'(t) s)/s without cancellation; over knots if they are to be `crossed`,
  !> else on the piece of t.
  pure real(wp) function rise(self, phase, piece, known, s, crossed) result(bend)
    type(curve_t), intent(in) :: self  !! flank
    real(wp), intent(in) :: phase      !! at t, mesh periods
    integer, intent(in) :: piece       !! its piece
    real(wp), intent(in) :: known(0:5) !! `derivatives` at t
    real(wp), intent(in) :: s          !! tau, positive
    logical, intent(in) :: crossed     !! whether the flank is that of each piece
    real(wp) :: left, here, width, slope, total, d(0:5), gain(2)
    integer :: at, j, round
    if (self%pieces == 0) then
      bend = 0
      do j = 1, size(self%terms, 2)
        bend = bend + series_rise(turned_term(self, j, phase), &
            s*self%terms(1, j)*two_pi/self%period)
      end do
      bend = bend/s
      return
    end if
    if (.not. crossed) then
      gain = gained(known, s)
      bend = gain(1)/s
      return
    end if
    left = s
    here = phase
    at = piece
    d = known
    slope = 0
    total = 0
    do round = 1, most_pieces_crossed
      width = (piece_begin(self, at + 1) - here)*self%period
      if (width >= left) exit
      ! What is gained on this piece beyond the tangent at t, and by how much the slope is larger.
      gain = gained(d, width)
      total = total + slope*width + gain(1)
      slope = slope + gain(2)
      at = at + 1
      here = piece_begin(self, at)
      d = derivatives(self, here, at)
      left = left - width
    end do
    gain = gained(d, left)
    bend = (total + slope*left + gain(1))/s
  end function rise

  !> What a piece gains in some time beyond its tangent, and by how much its slope does.
  pure function gained(d, s) result(gain)
    real(wp), intent(in) :: d(0:5)     !! derivatives
    real(wp), intent(in) :: s          !! time
    real(wp) :: gain(2), term
    integer :: k
    gain = 0
    do k = 5, 2, -1
      term = d(k)*over_factorial(k)
      gain = (gain + [term, term*k])*s
    end do
    gain(1) = gain(1)*s
  end function gained

  !> Real part of a turning term times e**ix - 1 - ix.
  pure real(wp) function series_rise(turned, x) result(value)
    complex(wp), intent(in) :: turned  !! the term at t
    real(wp), intent(in) :: x          !! the angle it turns by
    real(wp) :: less, term
    integer :: k
    less = sin(x) - x
    if (abs(x) < 1) then
      term = x
      less = 0
      do k = 1, 8
        term = -term*x*x/(2*k*(2*k + 1))
        less = less + term
      end do
    end if
    value = real(turned*cmplx(-2*sin(0.5_wp*x)**2, less, wp), wp)
  end function series_rise

end module lapwing_branch_curve
