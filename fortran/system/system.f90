!> What the integrator and the automaton ask of a mechanical system with two one-sided contacts.
!>
!> A system moves freely in `separation` and touches one flank in `engagement` or
!> `back_engagement`. Everything here is about *one step*: a frame is opened at its beginning, in
!> local coordinates z of the system's choice, and the flanks are polynomials in the time s since
!> then. The gear's frame moves with the flank last touched, so that the smallest bounce keeps
!> its full relative precision; a plain system takes z = y and leaves the frame alone.
module lapwing_system
  use lapwing_kinds, only: wp
  use lapwing_polynomial_evaluation, only: max_degree
  implicit none
  private
  public :: max_states, dense_degree
  public :: instant_t, frame_t, motion_t, step_t, reached_t, system_t, richardson, sixth, change, &
      stages_by_dispatch

  integer, parameter :: max_states = 8            !! largest number of state variables
  integer, parameter :: dense_degree = 5          !! degree of the dense output

  !> 1/(2**4 - 1): two half steps of a fourth-order formula against the whole one.
  real(wp), parameter :: richardson = 1.0_wp/15
  !> Products for quotients: stages wait for each other, and a division takes three times as long.
  real(wp), parameter :: third = 1.0_wp/3, sixth = 1.0_wp/6

  !> Where the system is.
  type :: instant_t
    integer :: motion_state = 0          !! separation, engagement or back_engagement
    integer :: chart = 1                 !! flank the coordinates y refer to (system's affair)
    integer :: touching = 0              !! flank at zero distance whose next move is decided
    integer :: cycle = 0                 !! mesh cycles completed since phase 0 of the first
    integer :: piece = 1                 !! table piece that holds t: where to look first
    real(wp) :: t = 0                    !! time since the cycle began, 0 <= t < period
    real(wp) :: y(max_states) = 0        !! state variables in the chart
  end type instant_t

  !> Local frame of one step, and the flanks over one table piece of it.
  type :: frame_t
    integer :: chart = 1                         !! chart of the instant it was opened at
    integer :: piece = 1                         !! table piece the flanks are expanded on
    integer :: stop_knot = 1                     !! knot where the frame ends
    real(wp) :: t = 0                            !! cycle time of s = 0
    real(wp) :: piece_begin = 0, piece_end = 0   !! span of the piece in s
    real(wp) :: stop = 0                         !! s that no step may pass
    real(wp) :: origin_rate = 0                  !! velocity of the frame, rad per tau
    real(wp) :: origin = 0                       !! position of the moving flank at s = 0, rad
    real(wp) :: flank(0:max_degree, 2) = 0       !! flank positions about s = piece_begin
  end type frame_t

  !> What the stages of a step give. Nothing is set beforehand: a step is too short for that.
  type :: step_t
    real(wp) :: middle(max_states)        !! local coordinates at s = h/2
    real(wp) :: end(max_states)           !! and at s = h
    real(wp) :: correction(max_states)    !! extrapolation at s = h: the error without it
    real(wp) :: rate_begin(max_states)    !! derivatives at s = 0
    real(wp) :: rate_middle(max_states)   !! at s = h/2
    real(wp) :: rate_end(max_states)      !! at s = h, where dense output is wanted
  end type step_t

  !> One accepted step as a polynomial: z(s) = sum_k dense(k,:) (s/h)**k.
  type :: motion_t
    real(wp) :: h = 0                                       !! step
    real(wp) :: dense(0:dense_degree, max_states) = 0       !! dense output
  end type motion_t

  !> The end of a smooth stretch in closed form.
  type :: reached_t
    integer :: flank = 0                 !! flank met, or none: it may go on
    integer :: chart = 1                 !! flank that y refers to: the one met, if any
    real(wp) :: s = 0                    !! duration
    real(wp) :: y(max_states) = 0        !! state variables, before whatever happens there
  end type reached_t

  type, abstract :: system_t
    integer :: n_states = 2        !! state variables in use
    integer :: n_flanks = 2        !! 2, or 1 where there is no coast flank
    real(wp) :: period = 1         !! length of a cycle in tau
    logical :: compliant = .false. !! contact without impact law
    logical :: rigid = .false.     !! an engaged tooth follows its flank; nothing else may move
                                   !! then (n_states = 2)
    logical :: closed_form = .false. !! moves by `stretch` and its like, not by steps
    real(wp) :: restitution = 1    !! used to sum a chatter; the law itself is `rebound`
  contains
    procedure(open_frame_i), deferred :: open_frame
    procedure(next_piece_i), deferred :: next_piece
    procedure(derivatives_i), deferred :: derivatives
    procedure(gap_i), deferred :: gap
    procedure(contact_i), deferred :: contact
    procedure(commit_i), deferred :: commit
    procedure(pressing_i), deferred :: pressing
    procedure(rebound_i), deferred :: rebound
    procedure(sums_chatter_i), deferred :: sums_chatter
    procedure(launch_i), deferred :: launch
    procedure(pass_knot_i), deferred :: pass_knot
    procedure(scales_i), deferred :: scales
    procedure(observe_i), deferred :: observe
    procedure :: stages => stages_by_dispatch
    procedure :: stay, leap
    ! Asked only of a system with a closed form, which overrides them.
    procedure :: stretch, inside, turn, deepest, rigid_release
  end type system_t

  abstract interface
    !> Open the local frame of a step at an instant; z(0) is in frame coordinates.
    pure subroutine open_frame_i(self, instant, frame, z)
      import :: system_t, instant_t, frame_t, max_states, wp
      implicit none
      class(system_t), intent(in) :: self
      type(instant_t), intent(in) :: instant       !! where the step begins
      type(frame_t), intent(out) :: frame          !! its frame
      real(wp), intent(out) :: z(max_states)       !! local coordinates of the instant
    end subroutine open_frame_i

    !> Re-expand the flanks on the table piece that follows.
    pure subroutine next_piece_i(self, frame)
      import :: system_t, frame_t
      implicit none
      class(system_t), intent(in) :: self
      type(frame_t), intent(inout) :: frame        !! frame, moved one piece on
    end subroutine next_piece_i

    !> dz/ds in a motion state. `frame` is as opened.
    pure subroutine derivatives_i(self, frame, motion_state, s, z, rate)
      import :: system_t, frame_t, wp
      implicit none
      class(system_t), intent(in) :: self
      type(frame_t), intent(in) :: frame           !! frame as opened
      integer, intent(in) :: motion_state          !! motion state
      real(wp), intent(in) :: s                    !! time since the frame was opened
      real(wp), intent(in) :: z(:)                 !! local coordinates
      real(wp), intent(out) :: rate(:)             !! their rates
    end subroutine derivatives_i

    !> Distance to a flank over the frame's piece, positive in separation, about piece_begin.
    pure subroutine gap_i(self, frame, flank, motion, c)
      import :: system_t, frame_t, motion_t, max_degree, wp
      implicit none
      class(system_t), intent(in) :: self
      type(frame_t), intent(in) :: frame           !! frame
      integer, intent(in) :: flank                 !! drive_flank or coast_flank
      type(motion_t), intent(in) :: motion         !! step as a polynomial
      real(wp), intent(out) :: c(0:max_degree)     !! coefficients in s - piece_begin
    end subroutine gap_i

    !> Distance and approach velocity to a flank at s within the frame's piece.
    pure subroutine contact_i(self, frame, flank, s, z, distance, approach)
      import :: system_t, frame_t, max_states, wp
      implicit none
      class(system_t), intent(in) :: self
      type(frame_t), intent(in) :: frame           !! frame
      integer, intent(in) :: flank                 !! flank
      real(wp), intent(in) :: s                    !! time since the frame was opened
      real(wp), intent(in) :: z(max_states)        !! local coordinates
      real(wp), intent(out) :: distance            !! positive in separation, rad
      real(wp), intent(out) :: approach            !! - d(distance)/d(tau)
    end subroutine contact_i

    !> State variables in the chart of a flank at s within the frame's piece.
    pure subroutine commit_i(self, frame, s, z, chart, y)
      import :: system_t, frame_t, max_states, wp
      implicit none
      class(system_t), intent(in) :: self
      type(frame_t), intent(in) :: frame           !! frame
      real(wp), intent(in) :: s                    !! time since the frame was opened
      real(wp), intent(in) :: z(max_states)        !! local coordinates
      integer, intent(in) :: chart                 !! flank to refer to
      real(wp), intent(out) :: y(max_states)       !! state variables
    end subroutine commit_i

    !> Acceleration with which a tooth at rest on a flank is pressed onto it, at s within the
    !> frame's piece and after.
    pure subroutine pressing_i(self, frame, flank, s, z, c)
      import :: system_t, frame_t, max_degree, max_states, wp
      implicit none
      class(system_t), intent(in) :: self
      type(frame_t), intent(in) :: frame           !! frame
      integer, intent(in) :: flank                 !! flank
      real(wp), intent(in) :: s                    !! time since the frame was opened
      real(wp), intent(in) :: z(max_states)        !! local coordinates at s
      real(wp), intent(out) :: c(0:max_degree)     !! Taylor coefficients about s
    end subroutine pressing_i

    !> Impact law: approach velocity after an impact (negative: the tooth rebounds).
    pure real(wp) function rebound_i(self, frame, flank, s, approach)
      import :: system_t, frame_t, wp
      implicit none
      class(system_t), intent(in) :: self
      type(frame_t), intent(in) :: frame           !! frame
      integer, intent(in) :: flank                 !! flank struck
      real(wp), intent(in) :: s                    !! time since the frame was opened
      real(wp), intent(in) :: approach             !! approach velocity before
    end function rebound_i

    !> Whether rebounds from a flank shrink by `restitution` each, so that a chatter has a sum.
    pure logical function sums_chatter_i(self, flank)
      import :: system_t
      implicit none
      class(system_t), intent(in) :: self
      integer, intent(in) :: flank                 !! flank
    end function sums_chatter_i

    !> Put a state that is at a flank exactly onto it, with the given approach velocity.
    pure subroutine launch_i(self, flank, approach, y)
      import :: system_t, max_states, wp
      implicit none
      class(system_t), intent(in) :: self
      integer, intent(in) :: flank                 !! flank the chart refers to
      real(wp), intent(in) :: approach             !! approach velocity, negative: leaves
      real(wp), intent(inout) :: y(max_states)     !! state variables in the flank's chart
    end subroutine launch_i

    !> Move an instant that has reached a knot past it; tells the velocity jump of a kink.
    pure subroutine pass_knot_i(self, knot, instant, is_kink, jump)
      import :: system_t, instant_t, wp
      implicit none
      class(system_t), intent(in) :: self
      integer, intent(in) :: knot                  !! knot reached
      type(instant_t), intent(inout) :: instant    !! state before, then after
      logical, intent(out) :: is_kink              !! whether the flank's slope jumps here
      real(wp), intent(out) :: jump                !! added to phi'
    end subroutine pass_knot_i

    !> Natural size of each state variable in a motion state: what relative tolerances refer to.
    pure subroutine scales_i(self, motion_state, scale)
      import :: system_t, max_states, wp
      implicit none
      class(system_t), intent(in) :: self
      integer, intent(in) :: motion_state          !! motion state
      real(wp), intent(out) :: scale(max_states)   !! sizes
    end subroutine scales_i

    !> What is reported: displacement from the drive flank and its rate.
    pure subroutine observe_i(self, instant, phi, phi_dot)
      import :: system_t, instant_t, wp
      implicit none
      class(system_t), intent(in) :: self
      type(instant_t), intent(in) :: instant       !! where the system is
      real(wp), intent(out) :: phi, phi_dot        !! rad, rad per tau
    end subroutine observe_i
  end interface

contains

  !> Change over a step by the four classical rates, about the first: where the rate is constant it
  !> is exact, and no rounding of weights adds up over many steps. After the last rate least is left
  !> to be done.
  pure elemental real(wp) function change(h, k1, k2, k3, k4)
    real(wp), intent(in) :: h                !! step
    real(wp), intent(in) :: k1, k2, k3, k4   !! rates at begin, twice in the middle, at the end
    change = (h*k1 + (h*third)*((k2 - k1) + (k3 - k1))) + (h*sixth)*(k4 - k1)
  end function change

  !> The stages of one step, each derivative through the system's own procedure.
  !> A system may override this with the same stages written out.
  subroutine stages_by_dispatch(self, frame, motion_state, h, z, dense, step)
    class(system_t), intent(in) :: self
    type(frame_t), intent(in) :: frame             !! frame as opened
    integer, intent(in) :: motion_state            !! motion state
    real(wp), intent(in) :: h                      !! step
    real(wp), intent(in) :: z(max_states)          !! local coordinates at s = 0
    logical, intent(in) :: dense                   !! whether the rate at the end is wanted
    type(step_t), intent(inout) :: step            !! the result
    real(wp), dimension(self%n_states) :: k2, k3, k4, middle, fine, coarse
    real(wp) :: half, quarter
    integer :: n
    half = 0.5_wp*h
    quarter = 0.25_wp*h
    n = self%n_states
    associate (z0 => z(1:n), k1 => step%rate_begin(1:n), k5 => step%rate_middle(1:n))
      call self%derivatives(frame, motion_state, 0.0_wp, z0, k1)
      call self%derivatives(frame, motion_state, quarter, z0 + quarter*k1, k2)
      call self%derivatives(frame, motion_state, quarter, z0 + quarter*k2, k3)
      call self%derivatives(frame, motion_state, half, z0 + half*k3, k4)
      middle = z0 + change(half, k1, k2, k3, k4)
      call self%derivatives(frame, motion_state, half, middle, k5)
      call self%derivatives(frame, motion_state, half + quarter, middle + quarter*k5, k2)
      call self%derivatives(frame, motion_state, half + quarter, middle + quarter*k2, k3)
      call self%derivatives(frame, motion_state, h, middle + half*k3, k4)
      fine = middle + change(half, k5, k2, k3, k4)
      call self%derivatives(frame, motion_state, half, z0 + half*k1, k2)
      call self%derivatives(frame, motion_state, half, z0 + half*k2, k3)
      call self%derivatives(frame, motion_state, h, z0 + h*k3, k4)
      coarse = z0 + change(h, k1, k2, k3, k4)
      step%correction(1:n) = richardson*(fine - coarse)
      step%middle(1:n) = middle + 0.5_wp*step%correction(1:n)
      step%end(1:n) = fine + step%correction(1:n)
      if (dense) then
        call self%derivatives(frame, motion_state, h, step%end(1:n), step%rate_end(1:n))
      end if
    end associate
  end subroutine stages_by_dispatch

  !> A step in contact that certainly stays inside the flank: the state at its end, without a look
  !> at the flank on the way. A system that knows nothing of the kind lets it be searched.
  pure subroutine stay(self, frame, motion, z_end, instant, stays)
    class(system_t), intent(in) :: self
    type(frame_t), intent(in) :: frame           !! frame as opened
    type(motion_t), intent(in) :: motion         !! step as a polynomial
    real(wp), intent(in) :: z_end(max_states)    !! local coordinates at its end
    type(instant_t), intent(inout) :: instant    !! its beginning; if it stays, y is its end's
    logical, intent(out) :: stays                !! whether it does
    stays = .false.
  end subroutine stay

  !> Go on in a flight, from the beginning of the frame's piece, over pieces on which it certainly
  !> meets no flank. A system that knows nothing of the kind stays where it is.
  pure subroutine leap(self, motion, frame, touching, clear)
    class(system_t), intent(in) :: self
    type(motion_t), intent(in) :: motion         !! step as a polynomial
    type(frame_t), intent(inout) :: frame        !! frame, on the piece to be searched next
    integer, intent(inout) :: touching           !! flank at zero distance where it begins, or none
    logical, intent(out) :: clear                !! whether nothing is met up to the step's end,
                                                 !! which the frame's piece then holds
    clear = .false.
  end subroutine leap

  !> The smooth stretch that begins at an instant.
  pure subroutine stretch(self, instant, stop, reached)
    class(system_t), intent(in) :: self
    type(instant_t), intent(in) :: instant       !! where it begins
    real(wp), intent(in) :: stop                 !! latest end
    type(reached_t), intent(out) :: reached      !! its end
    reached%chart = instant%chart
    reached%s = stop
    reached%y(1:self%n_states) = instant%y(1:self%n_states)
  end subroutine stretch

  !> State variables, in the chart of a stretch's beginning, at s after it.
  pure subroutine inside(self, begin, s, y)
    class(system_t), intent(in) :: self
    type(instant_t), intent(in) :: begin         !! where the stretch begins
    real(wp), intent(in) :: s                    !! time since then
    real(wp), intent(out) :: y(max_states)       !! state variables
    y = 0
    if (s >= 0) y(1:self%n_states) = begin%y(1:self%n_states)
  end subroutine inside

  !> First turn of the distance to a flank after `from`, which is zero or the last turn found.
  pure subroutine turn(self, begin, flank, from, until, found, s, distance, bend)
    class(system_t), intent(in) :: self
    type(instant_t), intent(in) :: begin         !! where the stretch begins
    integer, intent(in) :: flank                 !! flank
    real(wp), intent(in) :: from, until          !! times since then
    logical, intent(out) :: found                !! whether there is one
    real(wp), intent(out) :: s                   !! when
    real(wp), intent(out) :: distance            !! positive in separation, rad
    real(wp), intent(out) :: bend                !! its second derivative
    found = .false.
    s = until
    distance = 0
    bend = 0
  end subroutine turn

  !> Largest distance from the drive flank, or depth in the coast flank, over a stretch, if it
  !> exceeds `least`.
  pure real(wp) function deepest(self, begin, flank, until, least)
    class(system_t), intent(in) :: self
    type(instant_t), intent(in) :: begin         !! where the stretch begins
    integer, intent(in) :: flank                 !! flank
    real(wp), intent(in) :: until                !! its length
    real(wp), intent(in) :: least                !! value known already, rad
    deepest = least
  end function deepest

  !> When a tooth in rigid contact would be pulled, where the flank is no table.
  pure subroutine rigid_release(self, instant, stop, answered, found, s)
    class(system_t), intent(in) :: self
    type(instant_t), intent(in) :: instant       !! where the tooth is
    real(wp), intent(in) :: stop                 !! latest end
    logical, intent(out) :: answered             !! whether the rest says anything
    logical, intent(out) :: found                !! whether it is
    real(wp), intent(out) :: s                   !! when
    answered = .false.
    found = .false.
    s = stop
  end subroutine rigid_release
end module lapwing_system
