!> Systems of known answers that are not the gear: proof that step formula, event search and
!> automaton serve any `system_t`.
module test_systems
  use lapwing_kinds, only: wp
  use lapwing_codes, only: separation, drive_flank, coast_flank
  use lapwing_system_oscillator, only: oscillator_t, make_oscillator
  use lapwing_system_parameters, only: parameters_t
  use lapwing_polynomial_evaluation, only: max_degree
  use lapwing_system, only: system_t, instant_t, frame_t, motion_t, max_states, dense_degree
  implicit none
  private
  public :: plain_system_t, ball_t, forced_mass_t, two_masses_t, swirl_t, trees_t
  public :: dispatched_t, thorough_t, careful_t, careful, oscillator

  !> y(1) and y(2), a position and its rate, are what meets the walls: the drive flank from below,
  !> the coast flank from above. Local coordinates are y itself, a cycle has no knots.
  type, abstract, extends(system_t) :: plain_system_t
    real(wp) :: wall(2) = [0.0_wp, -1.0e3_wp]   !! drive flank, coast flank
    real(wp) :: size(max_states) = 1            !! natural sizes
  contains
    procedure :: open_frame, next_piece, gap, contact, commit
    procedure :: place_at_flank, pass_knot, scales, observe
    procedure :: derivatives => still, pressing => no_pressing
  end type plain_system_t

  !> A ball under a constant acceleration towards the drive flank, the floor.
  type, extends(plain_system_t) :: ball_t
    real(wp) :: pull = 1                        !! acceleration
  contains
    procedure :: derivatives => ball_rate, pressing => ball_pressing
  end type ball_t

  !> x'' = -x + amplitude cos(2 pi t/period), with a wall.
  type, extends(plain_system_t) :: forced_mass_t
    real(wp) :: amplitude = 0                   !! of the force
  contains
    procedure :: derivatives => forced_rate, pressing => forced_pressing
  end type forced_mass_t

  !> Two masses in a row, each on a spring, coupled by a third, and by a damper if there is one; the
  !> first one meets the wall.
  !> y = (x1, v1, x2, v2). `wall_stiffness` acts in contact.
  type, extends(plain_system_t) :: two_masses_t
    real(wp) :: mass(2) = 1                     !! masses
    real(wp) :: stiffness(2) = 1                !! to the ground
    real(wp) :: coupling = 1                    !! between them
    real(wp) :: damper = 0                      !! between them
    real(wp) :: wall_stiffness = 0              !! in contact
  contains
    procedure :: derivatives => two_masses_rate, pressing => two_masses_pressing
  end type two_masses_t

  !> Nonlinear, coupled, explicit in time, and solved by hand: with r**2 = y1**2 + y2**2,
  !> y' = r**2 (1 + t) (-y2, y1) turns y through the angle r**2 (t + t**2/2).
  type, extends(plain_system_t) :: swirl_t
  contains
    procedure :: derivatives => swirl_rate
  end type swirl_t

  !> The order conditions as a system. From y = 0, y(1)' = 1 and the others integrate products of
  !> earlier ones: one step of a Runge-Kutta formula gives h**r sum b Phi for the rooted tree that
  !> the product stands for, exactly h**r/density if its condition holds. y(1:7) are the trees up to
  !> order 4 but the tall one; y(8) is the tall one (`variant` 0) or one of order 5 (1 .. 9).
  type, extends(plain_system_t) :: trees_t
    integer :: variant = 0                      !! which tree y(8) stands for
  contains
    procedure :: derivatives => trees_rate
  end type trees_t

  !> The gear's derivatives through dispatch: it does not override `stages`.
  type, extends(plain_system_t) :: dispatched_t
    type(oscillator_t) :: inner                 !! the gear
  contains
    procedure :: derivatives => dispatched_rate
  end type dispatched_t

  !> The gear, its arcs searched on every piece of the table.
  type, extends(oscillator_t) :: thorough_t
  contains
    procedure :: skip_ahead => skip_nothing
    procedure :: bound_depth => bound_nothing
  end type thorough_t

  !> The gear, looked at as if it knew nothing to save work by at the beginning of an arc or after
  !> an impact.
  type, extends(oscillator_t) :: careful_t
  contains
    procedure :: begins_clear => never
  end type careful_t

contains

  !> Oscillator over a table, or over a series if one is given.
  function oscillator(parameters, knots, coefficients, kinks, series) result(self)
    type(parameters_t), intent(in) :: parameters
    real(wp), intent(in) :: knots(:), coefficients(0:, :)
    logical, intent(in) :: kinks(:)
    real(wp), intent(in), optional :: series(:, :)
    type(oscillator_t) :: self
    real(wp), parameter :: none(3, 1) = reshape([-1.0_wp, 0.0_wp, 0.0_wp], [3, 1])
    integer :: error
    logical :: alone
    alone = present(series)
    if (alone) alone = series(1, 1) >= 0
    if (alone) then
      call make_oscillator(parameters, knots(:1), coefficients(:, :0), kinks(:0), series, self, &
          error)
    else
      call make_oscillator(parameters, knots, coefficients, kinks, none, self, error)
    end if
    if (error /= 0) error stop "no memory"
  end function oscillator

  function careful(system) result(self)
    type(oscillator_t), intent(in) :: system
    type(careful_t) :: self
    self%oscillator_t = system
    self%strongest = huge(1.0_wp)
  end function careful

  pure logical function never(self, instant, shortest) result(clear)
    class(careful_t), intent(in) :: self
    type(instant_t), intent(in) :: instant
    real(wp), intent(in) :: shortest
    clear = .false.
  end function never

  pure subroutine skip_nothing(self, motion_state, motion, frame, touching, clear)
    class(thorough_t), intent(in) :: self
    integer, intent(in) :: motion_state
    type(motion_t), intent(in) :: motion
    type(frame_t), intent(inout) :: frame
    integer, intent(inout) :: touching
    logical, intent(out) :: clear
    clear = .false.
  end subroutine skip_nothing

  pure subroutine bound_nothing(self, motion, length, frame, floor, until)
    class(thorough_t), intent(in) :: self
    type(motion_t), intent(in) :: motion
    real(wp), intent(in) :: length
    type(frame_t), intent(in) :: frame
    real(wp), intent(inout) :: floor
    real(wp), intent(out) :: until
    until = 0
  end subroutine bound_nothing

  pure subroutine open_frame(self, instant, frame)
    class(plain_system_t), intent(in) :: self
    type(instant_t), intent(in) :: instant
    type(frame_t), intent(inout) :: frame
    frame = frame_t()
    frame%t = instant%t
    frame%chart = instant%chart
    frame%stop = self%period - instant%t
    frame%piece_end = frame%stop
  end subroutine open_frame

  !> There is one piece per cycle.
  pure subroutine next_piece(self, frame)
    class(plain_system_t), intent(in) :: self
    type(frame_t), intent(inout) :: frame
    frame%piece_begin = frame%piece_end
    frame%piece_end = self%period - frame%t
  end subroutine next_piece

  pure subroutine gap(self, frame, flank, motion, c)
    class(plain_system_t), intent(in) :: self
    type(frame_t), intent(in) :: frame
    integer, intent(in) :: flank
    type(motion_t), intent(in) :: motion
    real(wp), intent(out) :: c(0:max_degree)
    real(wp) :: inverse_power
    integer :: k
    c = 0
    inverse_power = 1
    do k = 0, dense_degree
      c(k) = -motion%dense(k, 1)*inverse_power
      inverse_power = inverse_power/motion%h
    end do
    c(0) = c(0) + self%wall(flank)
    if (flank == coast_flank) c = -c
  end subroutine gap

  pure subroutine contact(self, frame, flank, s, z, distance, approach)
    class(plain_system_t), intent(in) :: self
    type(frame_t), intent(in) :: frame
    integer, intent(in) :: flank
    real(wp), intent(in) :: s
    real(wp), intent(in) :: z(max_states)
    real(wp), intent(out) :: distance, approach
    distance = self%wall(flank) - z(1)
    approach = z(2)
    if (flank == drive_flank) return
    distance = -distance
    approach = -approach
  end subroutine contact

  pure subroutine commit(self, frame, s, z, chart, y)
    class(plain_system_t), intent(in) :: self
    type(frame_t), intent(in) :: frame
    real(wp), intent(in) :: s
    real(wp), intent(in) :: z(max_states)
    integer, intent(in) :: chart
    real(wp), intent(out) :: y(max_states)
    y = 0
    y(1:self%n_states) = z(1:self%n_states)
  end subroutine commit

  pure subroutine place_at_flank(self, flank, approach, y)
    class(plain_system_t), intent(in) :: self
    integer, intent(in) :: flank
    real(wp), intent(in) :: approach
    real(wp), intent(inout) :: y(max_states)
    y(1:2) = [self%wall(flank), merge(approach, -approach, flank == drive_flank)]
  end subroutine place_at_flank

  pure subroutine pass_knot(self, knot, instant, is_kink, jump)
    class(plain_system_t), intent(in) :: self
    integer, intent(in) :: knot
    type(instant_t), intent(inout) :: instant
    logical, intent(out) :: is_kink
    real(wp), intent(out) :: jump
    instant%cycle = instant%cycle + 1
    instant%t = 0
    is_kink = .false.
    jump = 0
  end subroutine pass_knot

  pure subroutine scales(self, motion_state, scale)
    class(plain_system_t), intent(in) :: self
    integer, intent(in) :: motion_state
    real(wp), intent(out) :: scale(max_states)
    scale = self%size
  end subroutine scales

  pure subroutine observe(self, instant, phi, phi_dot)
    class(plain_system_t), intent(in) :: self
    type(instant_t), intent(in) :: instant
    real(wp), intent(out) :: phi, phi_dot
    phi = instant%y(1) - self%wall(drive_flank)
    phi_dot = instant%y(2)
  end subroutine observe

  pure subroutine still(self, frame, motion_state, s, z, rate)
    class(plain_system_t), intent(in) :: self
    type(frame_t), intent(in) :: frame
    integer, intent(in) :: motion_state
    real(wp), intent(in) :: s
    real(wp), intent(in) :: z(:)
    real(wp), intent(out) :: rate(:)
    rate = 0
    rate(1) = z(2)
  end subroutine still

  pure subroutine no_pressing(self, frame, flank, s, z, c)
    class(plain_system_t), intent(in) :: self
    type(frame_t), intent(in) :: frame
    integer, intent(in) :: flank
    real(wp), intent(in) :: s
    real(wp), intent(in) :: z(max_states)
    real(wp), intent(out) :: c(0:max_degree)
    c = 0
  end subroutine no_pressing

  pure subroutine ball_rate(self, frame, motion_state, s, z, rate)
    class(ball_t), intent(in) :: self
    type(frame_t), intent(in) :: frame
    integer, intent(in) :: motion_state
    real(wp), intent(in) :: s
    real(wp), intent(in) :: z(:)
    real(wp), intent(out) :: rate(:)
    rate = [z(2), self%pull]
    if (motion_state /= separation) rate = 0
  end subroutine ball_rate

  pure subroutine ball_pressing(self, frame, flank, s, z, c)
    class(ball_t), intent(in) :: self
    type(frame_t), intent(in) :: frame
    integer, intent(in) :: flank
    real(wp), intent(in) :: s
    real(wp), intent(in) :: z(max_states)
    real(wp), intent(out) :: c(0:max_degree)
    c = 0
    c(0) = merge(self%pull, -self%pull, flank == drive_flank)
  end subroutine ball_pressing

  pure real(wp) function angular_frequency(self)
    class(forced_mass_t), intent(in) :: self
    angular_frequency = 8*atan(1.0_wp)/self%period
  end function angular_frequency

  pure subroutine forced_rate(self, frame, motion_state, s, z, rate)
    class(forced_mass_t), intent(in) :: self
    type(frame_t), intent(in) :: frame
    integer, intent(in) :: motion_state
    real(wp), intent(in) :: s
    real(wp), intent(in) :: z(:)
    real(wp), intent(out) :: rate(:)
    rate = [z(2), -z(1) + self%amplitude*cos(angular_frequency(self)*(frame%t + s))]
    if (motion_state /= separation) rate = 0
  end subroutine forced_rate

  !> Taylor polynomial of the force.
  pure subroutine forced_pressing(self, frame, flank, s, z, c)
    class(forced_mass_t), intent(in) :: self
    type(frame_t), intent(in) :: frame
    integer, intent(in) :: flank
    real(wp), intent(in) :: s
    real(wp), intent(in) :: z(max_states)
    real(wp), intent(out) :: c(0:max_degree)
    real(wp) :: w, angle
    w = angular_frequency(self)
    angle = w*(frame%t + s)
    c(0:3) = self%amplitude*[cos(angle), -w*sin(angle), -w**2*cos(angle)/2, w**3*sin(angle)/6]
    c(4:5) = self%amplitude*[w**4*cos(angle)/24, -w**5*sin(angle)/120]
    c(0) = c(0) - self%wall(flank)
    if (flank == coast_flank) c = -c
  end subroutine forced_pressing

  pure subroutine two_masses_rate(self, frame, motion_state, s, z, rate)
    class(two_masses_t), intent(in) :: self
    type(frame_t), intent(in) :: frame
    integer, intent(in) :: motion_state
    real(wp), intent(in) :: s
    real(wp), intent(in) :: z(:)
    real(wp), intent(out) :: rate(:)
    real(wp) :: between
    between = self%coupling*(z(1) - z(3)) + self%damper*(z(2) - z(4))
    rate(1) = z(2)
    rate(2) = -(self%stiffness(1)*z(1) + between)/self%mass(1)
    rate(3) = z(4)
    rate(4) = -(self%stiffness(2)*z(3) - between)/self%mass(2)
    if (motion_state == separation) return
    rate(2) = rate(2) - self%wall_stiffness*(z(1) - self%wall(frame%chart))/self%mass(1)
  end subroutine two_masses_rate

  !> With the first mass held at the wall: Taylor polynomial of the second one's motion.
  pure subroutine two_masses_pressing(self, frame, flank, s, z, c)
    class(two_masses_t), intent(in) :: self
    type(frame_t), intent(in) :: frame
    integer, intent(in) :: flank
    real(wp), intent(in) :: s
    real(wp), intent(in) :: z(max_states)
    real(wp), intent(out) :: c(0:max_degree)
    real(wp) :: x2(0:max_degree + 1), wall
    integer :: k
    wall = self%wall(flank)
    x2(0:1) = z(3:4)
    do k = 2, max_degree + 1
      x2(k) = -(self%stiffness(2) + self%coupling)*x2(k - 2) - self%damper*(k - 1)*x2(k - 1)
      if (k == 2) x2(k) = x2(k) + self%coupling*wall
      x2(k) = x2(k)/(self%mass(2)*k*(k - 1))
    end do
    do k = 0, max_degree
      c(k) = (self%coupling*x2(k) + self%damper*(k + 1)*x2(k + 1))/self%mass(1)
    end do
    c(0) = c(0) - (self%stiffness(1) + self%coupling)*wall/self%mass(1)
    if (flank == coast_flank) c = -c
  end subroutine two_masses_pressing

  pure subroutine swirl_rate(self, frame, motion_state, s, z, rate)
    class(swirl_t), intent(in) :: self
    type(frame_t), intent(in) :: frame
    integer, intent(in) :: motion_state
    real(wp), intent(in) :: s
    real(wp), intent(in) :: z(:)
    real(wp), intent(out) :: rate(:)
    rate = (z(1)**2 + z(2)**2)*(1 + frame%t + s)*[-z(2), z(1)]
  end subroutine swirl_rate

  pure subroutine trees_rate(self, frame, motion_state, s, z, rate)
    class(trees_t), intent(in) :: self
    type(frame_t), intent(in) :: frame
    integer, intent(in) :: motion_state
    real(wp), intent(in) :: s
    real(wp), intent(in) :: z(:)
    real(wp), intent(out) :: rate(:)
    real(wp) :: order_5(0:9)
    rate(1:7) = [1.0_wp, z(1), z(1)**2, z(2), z(1)**3, z(1)*z(2), z(3)]
    order_5 = [z(4), z(1)**4, z(1)**2*z(2), z(1)*z(3), z(1)*z(4), z(2)**2, z(5), z(6), z(7), z(7)]
    rate(8) = order_5(self%variant)
    ! The tall tree of order 5 needs the tall one of order 4 below it.
    if (self%variant == 9) rate(7) = z(4)
  end subroutine trees_rate

  pure subroutine dispatched_rate(self, frame, motion_state, s, z, rate)
    class(dispatched_t), intent(in) :: self
    type(frame_t), intent(in) :: frame
    integer, intent(in) :: motion_state
    real(wp), intent(in) :: s
    real(wp), intent(in) :: z(:)
    real(wp), intent(out) :: rate(:)
    call self%inner%derivatives(frame, motion_state, s, z, rate)
  end subroutine dispatched_rate
end module test_systems
