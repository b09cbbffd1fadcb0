!> What the integrator and the automaton ask of a mechanical system with two one-sided contacts.
!>
!> A system moves freely in `separation` and touches one flank in `engagement` or
!> `back_engagement`. Everything here is about *one step*: a frame is opened at its beginning, in
!> local coordinates z of the system's choice, and the flanks are polynomials in the time s since
!> then. The gear's frame moves with the flank last touched, so that the smallest bounce keeps
!> its full relative precision; a plain system takes z = y and leaves the frame alone.
module lapwing_system
  use lapwing_kinds, only: wp
  use lapwing_codes, only: drive_flank
  use lapwing_contact_law, only: contact_law_t
  use lapwing_polynomial_evaluation, only: max_degree
  use lapwing_system_step, only: step_t, lengths_t, max_states
  implicit none
  private
  public :: max_states, dense_degree
  public :: instant_t, frame_t, motion_t, step_t, system_t, approach_velocity

  integer, parameter :: dense_degree = 5          !! degree of the dense output

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
    integer :: piece = 1                         !! table piece the flanks are expanded on; 0: they
                                                 !! are not, see `complete_frame`
    integer :: stop_knot = 1                     !! knot where the frame ends
    real(wp) :: t = 0                            !! cycle time of s = 0
    real(wp) :: piece_begin = 0, piece_end = 0   !! span of the piece in s
    real(wp) :: stop = 0                         !! s that no step may pass
    real(wp) :: origin_rate = 0                  !! velocity of the frame, rad per tau
    real(wp) :: origin = 0                       !! position of the moving flank at s = 0, rad
    real(wp) :: flank(0:max_degree, 2) = 0       !! flank positions about s = piece_begin
  end type frame_t

  !> One accepted step as a polynomial: z(s) = sum_k dense(k,:) (s/h)**k.
  type :: motion_t
    real(wp) :: h = 0                                       !! step
    real(wp) :: dense(0:dense_degree, max_states) = 0       !! dense output
    real(wp) :: landing(2) = 0                              !! see `step_t`
    type(lengths_t), allocatable :: lengths                 !! what the next step may use
  end type motion_t

  type, abstract :: system_t
    integer :: n_states = 2        !! state variables in use
    integer :: n_flanks = 2        !! 2, or 1 where there is no coast flank
    real(wp) :: period = 1         !! length of a cycle in tau
    class(contact_law_t), allocatable :: law   !! what happens at a flank; under a rigid one nothing
                                               !! else may move (n_states = 2)
    !> Bound of the acceleration that presses a tooth onto a flank: what is slow against it might
    !> come to rest.
    real(wp) :: strongest = huge(1.0_wp)
  contains
    procedure(open_frame_i), deferred :: open_frame
    procedure(next_piece_i), deferred :: next_piece
    procedure(derivatives_i), deferred :: derivatives
    procedure(gap_i), deferred :: gap
    procedure(contact_i), deferred :: contact
    procedure(commit_i), deferred :: commit
    procedure(pressing_i), deferred :: pressing
    procedure(place_at_flank_i), deferred :: place_at_flank
    procedure(pass_knot_i), deferred :: pass_knot
    procedure(scales_i), deferred :: scales
    procedure(observe_i), deferred :: observe
    ! What a system may know better, to save work.
    procedure :: begins_clear => never_clear
    procedure :: limit_step => as_opened
    procedure :: moves => always
    procedure :: flank_velocity => at_rest
    procedure :: stages => left_to_formula
    procedure :: complete_frame => as_it_is
    procedure :: stay, skip_ahead, bound_depth
  end type system_t

  abstract interface
    !> Open the local frame of an instant, up to the next kink or the end of the cycle. Local
    !> coordinates begin with the state variables: z = y at s = 0.
    pure subroutine open_frame_i(self, instant, frame)
      import :: system_t, instant_t, frame_t
      implicit none
      class(system_t), intent(in) :: self
      type(instant_t), intent(in) :: instant       !! where it opens
      type(frame_t), intent(inout) :: frame        !! its frame
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
      integer, intent(in) :: motion_state
      real(wp), intent(in) :: s                    !! time since the frame was opened
      real(wp), intent(in) :: z(:)                 !! local coordinates
      real(wp), intent(out) :: rate(:)             !! their rates
    end subroutine derivatives_i

    !> Distance to a flank over the frame's piece, positive in separation, about piece_begin.
    pure subroutine gap_i(self, frame, flank, motion, c)
      import :: system_t, frame_t, motion_t, max_degree, wp
      implicit none
      class(system_t), intent(in) :: self
      type(frame_t), intent(in) :: frame
      integer, intent(in) :: flank                 !! drive_flank or coast_flank
      type(motion_t), intent(in) :: motion         !! step as a polynomial
      real(wp), intent(out) :: c(0:max_degree)     !! coefficients in s - piece_begin
    end subroutine gap_i

    !> Distance and approach velocity to a flank at s within the frame's piece.
    pure subroutine contact_i(self, frame, flank, s, z, distance, approach)
      import :: system_t, frame_t, max_states, wp
      implicit none
      class(system_t), intent(in) :: self
      type(frame_t), intent(in) :: frame
      integer, intent(in) :: flank
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
      type(frame_t), intent(in) :: frame
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
      type(frame_t), intent(in) :: frame
      integer, intent(in) :: flank
      real(wp), intent(in) :: s                    !! time since the frame was opened
      real(wp), intent(in) :: z(max_states)        !! local coordinates at s
      real(wp), intent(out) :: c(0:max_degree)     !! Taylor coefficients about s
    end subroutine pressing_i

    !> Put a state that is at a flank exactly onto it, with the given approach velocity.
    pure subroutine place_at_flank_i(self, flank, approach, y)
      import :: system_t, max_states, wp
      implicit none
      class(system_t), intent(in) :: self
      integer, intent(in) :: flank                 !! flank the chart refers to
      real(wp), intent(in) :: approach             !! approach velocity, negative: leaves
      real(wp), intent(inout) :: y(max_states)     !! state variables in the flank's chart
    end subroutine place_at_flank_i

    !> Move an instant that has reached a knot past it, and its velocity jump if it is a kink.
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
      integer, intent(in) :: motion_state
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

  !> Approach velocity of a state that is at a flank, to which y(1) and y(2), a distance and its
  !> rate, refer in every system.
  pure real(wp) function approach_velocity(flank, y)
    integer, intent(in) :: flank
    real(wp), intent(in) :: y(max_states)    !! state variables
    approach_velocity = merge(y(2), -y(2), flank == drive_flank)
  end function approach_velocity

  !> The stages of a step in contact or in flight, written out for the system's own equations. The
  !> default leaves them to the formula.
  subroutine left_to_formula(self, frame, motion_state, h, z, lengths, step, done)
    class(system_t), intent(in) :: self
    type(frame_t), intent(in) :: frame             !! frame as opened
    integer, intent(in) :: motion_state
    real(wp), intent(in) :: h                      !! step
    real(wp), intent(in) :: z(max_states)          !! local coordinates at s = 0
    type(lengths_t), intent(inout), optional :: lengths   !! what steps of one length share;
                                                          !! absent: it will not come again
    type(step_t), intent(inout) :: step            !! the result
    logical, intent(out) :: done                   !! whether there is one
    done = .false.
  end subroutine left_to_formula

  !> Look up what a frame was opened without: the flanks, of a system that takes a step in contact
  !> without a look at them.
  pure subroutine as_it_is(self, frame)
    class(system_t), intent(in) :: self
    type(frame_t), intent(inout) :: frame          !! frame as opened
  end subroutine as_it_is

  !> A step in contact that certainly stays inside the flank: the state at its end, without a look
  !> at the flank on the way. The default claims nothing: the step is searched.
  pure subroutine stay(self, frame, begin, motion, z_end, y, stays)
    class(system_t), intent(in) :: self
    type(frame_t), intent(in) :: frame           !! frame as opened
    type(instant_t), intent(in) :: begin         !! where the step begins
    type(motion_t), intent(in) :: motion         !! step as a polynomial
    real(wp), intent(in) :: z_end(max_states)    !! local coordinates at its end
    real(wp), intent(inout) :: y(max_states)     !! if it stays: state variables there
    logical, intent(out) :: stays                !! whether it does
    stays = .false.
  end subroutine stay

  !> Go on, from the beginning of the frame's piece, over pieces on which a flight certainly meets
  !> no flank and a contact leaves none. The default claims nothing: every piece is searched.
  pure subroutine skip_ahead(self, motion_state, motion, frame, touching, clear)
    class(system_t), intent(in) :: self
    integer, intent(in) :: motion_state
    type(motion_t), intent(in) :: motion         !! step as a polynomial
    type(frame_t), intent(inout) :: frame        !! frame, on the piece to be searched next
    integer, intent(inout) :: touching           !! flank at zero distance where it begins, or none
    logical, intent(out) :: clear                !! whether nothing is met up to the step's end,
                                                 !! which the frame's piece then holds
    clear = .false.
  end subroutine skip_ahead

  !> In a flight, what spares a search for its largest distance from the drive flank. The default
  !> claims nothing: every piece is looked at.
  pure subroutine bound_depth(self, motion, length, frame, floor, until)
    class(system_t), intent(in) :: self
    type(motion_t), intent(in) :: motion         !! step as a polynomial
    real(wp), intent(in) :: length               !! how much of it counts
    type(frame_t), intent(in) :: frame           !! frame, as opened or at a piece's beginning
    real(wp), intent(inout) :: floor             !! distance that is exceeded, perhaps raised
    real(wp), intent(out) :: until               !! time up to which it is not
    until = 0
  end subroutine bound_depth

  !> Whether an arc certainly begins off all flanks, or on its way from one or into one, so that
  !> nothing is to be decided there. A tooth that leaves with v might be at the end of a chatter if
  !> 2 v/(a (1 - eps)) <= `shortest`, a the acceleration that presses it back. A system that does
  !> not say so is looked at.
  pure logical function never_clear(self, instant, shortest)
    class(system_t), intent(in) :: self
    type(instant_t), intent(in) :: instant       !! where it begins
    real(wp), intent(in) :: shortest             !! duration of a chatter that is followed, tau
    never_clear = .false.
  end function never_clear

  !> Let a frame end where a step of a formula must end for its accuracy.
  pure subroutine as_opened(self, instant, frame)
    class(system_t), intent(in) :: self
    type(instant_t), intent(in) :: instant       !! where it opens
    type(frame_t), intent(inout) :: frame
  end subroutine as_opened

  !> Whether a flank moves, so that the impacts on it may gain speed.
  pure logical function always(self, flank)
    class(system_t), intent(in) :: self
    integer, intent(in) :: flank
    always = .true.
  end function always

  !> Velocity of a flank at s within a frame's piece.
  pure real(wp) function at_rest(self, frame, flank, s)
    class(system_t), intent(in) :: self
    type(frame_t), intent(in) :: frame
    integer, intent(in) :: flank
    real(wp), intent(in) :: s                    !! time since it was opened
    at_rest = 0
  end function at_rest
end module lapwing_system
