!> The stages of a step written out for the gear's two equations of motion: what flow/rk4/step.f90
!> does with their derivatives, to rounding, at a tenth of its price.
!>
!> Under the classical formula a damped spring answers linearly to its state and to the force at the
!> formula's nodes, and how it answers depends on the length of the step alone. With L the spring's
!> matrix and A = h L every answer is a polynomial of A: the stages multiplied out, and the doubled
!> step extrapolated. They are made when the length changes, and kept.
module lapwing_system_spring_stages
  use lapwing_kinds, only: wp
  use lapwing_flank, only: flank_t
  use lapwing_flank_series, only: harmonic_series_t, turned_t, turn_series, versed
  use lapwing_system, only: frame_t
  use lapwing_system_frames, only: flank_in_frame, flank_over_step
  use lapwing_system_step, only: step_t, kept_t, lengths_t, richardson
  implicit none
  private
  public :: drive, stages_in_contact, flight_stages

contains

  !> The stages of a step in contact.
  subroutine stages_in_contact(flank, series, damping, force, moves, frame, h, z, lengths, step)
    class(flank_t), intent(in) :: flank      !! motion of the flanks
    type(harmonic_series_t), allocatable, intent(in) :: series   !! the same, where it is one
    real(wp), intent(in) :: damping          !! 2 xi
    real(wp), intent(in) :: force            !! what drives the spring at s = 0
    logical, intent(in) :: moves             !! whether the flank of the frame's chart does
    type(frame_t), intent(in) :: frame       !! frame as opened
    real(wp), intent(in) :: h                !! step
    real(wp), intent(in) :: z(2)             !! position and velocity at s = 0
    type(lengths_t), intent(inout), optional :: lengths   !! lengths of late; absent: it is not kept
    type(step_t), intent(inout) :: step      !! the result
    type(kept_t) :: once
    logical :: is_new
    if (present(lengths)) then
      call lengths%look_up(h, is_new)
      if (is_new) call keep(damping, series, h, lengths%kept(lengths%at))
      call with_length(lengths%kept(lengths%at))
    else
      call keep(damping, series, h, once)
      call with_length(once)
    end if

  contains

    !> What hangs on the length alone is known.
    subroutine with_length(kept)
      type(kept_t), intent(in) :: kept
      real(wp) :: driven(4)
      call drive_over_step(flank, series, damping, moves, frame, kept, driven, step%landing)
      call spring_stages(damping, force, driven, kept, z, step)
    end subroutine with_length
  end subroutine stages_in_contact

  !> What drives the spring beyond the force at s: the motion of its flank in the frame.
  pure real(wp) function drive(flank, series, damping, frame, s)
    class(flank_t), intent(in) :: flank      !! motion of the flanks
    type(harmonic_series_t), allocatable, intent(in) :: series   !! the same, where it is one
    real(wp), intent(in) :: damping          !! 2 xi
    type(frame_t), intent(in) :: frame       !! frame as opened
    real(wp), intent(in) :: s                !! time since the frame was opened
    real(wp) :: position, slope
    drive = 0
    if (s <= 0) return
    if (allocated(series)) then
      call series_in_frame(series, frame%t, s, position, slope)
    else
      call flank_in_frame(flank, frame, s, position, slope)
    end if
    drive = position + damping*slope
  end function drive

  !> The same at the quarters of a step, and where the flank is at its end.
  pure subroutine drive_over_step(flank, series, damping, moves, frame, kept, driven, landing)
    class(flank_t), intent(in) :: flank      !! motion of the flanks
    type(harmonic_series_t), allocatable, intent(in) :: series   !! the same, where it is one
    real(wp), intent(in) :: damping          !! 2 xi
    logical, intent(in) :: moves             !! whether the flank of the frame's chart does
    type(frame_t), intent(in) :: frame       !! frame as opened
    type(kept_t), intent(in) :: kept         !! of the step's length
    real(wp), intent(out) :: driven(4)       !! at its quarters
    real(wp), intent(out) :: landing(2)      !! flank's position and velocity at s = h
    real(wp) :: position(4), slope(4)
    driven = 0
    landing = 0
    if (.not. moves) return
    if (allocated(series)) then
      call series_over_step(series, frame%t, kept, driven, landing)
    else
      call flank_over_step(flank, frame, kept%h, position, slope)
      driven = position + damping*slope
      landing = [position(4), slope(4)]
    end if
  end subroutine drive_over_step

  !> The same of a flank that moves as a series.
  pure subroutine series_over_step(series, t, kept, driven, landing)
    type(harmonic_series_t), intent(in) :: series   !! motion of the flank
    real(wp), intent(in) :: t                !! time at s = 0
    type(kept_t), intent(in) :: kept         !! of the step's length
    real(wp), intent(out) :: driven(4)       !! at its quarters
    real(wp), intent(out) :: landing(2)      !! flank's position and velocity at s = h
    real(wp) :: c, s, even, odd
    integer :: i
    driven = 0
    landing = 0
    do i = 1, size(series%rate)
      c = cos(series%rate(i)*t)
      s = sin(series%rate(i)*t)
      even = series%cosine(i)*c + series%sine(i)*s
      odd = series%sine(i)*c - series%cosine(i)*s
      driven = driven + (even*kept%from_cosine(1:4, i) + odd*kept%from_sine(1:4, i))
      landing = landing + (even*kept%from_cosine(5:6, i) + odd*kept%from_sine(5:6, i))
    end do
  end subroutine series_over_step

  !> Position and velocity, at s in the frame that opened at t, of a flank that moves as a series.
  pure subroutine series_in_frame(series, t, s, position, slope)
    type(harmonic_series_t), intent(in) :: series   !! motion of the flank
    real(wp), intent(in) :: t, s             !! when the frame was opened, time since then
    real(wp), intent(out) :: position, slope !! in the frame
    type(turned_t) :: turned
    real(wp) :: versine, sine, lag, even, odd
    integer :: i
    call turn_series(series, t, turned)
    position = 0
    slope = 0
    do i = 1, size(series%rate)
      call versed(series%rate(i)*s, versine, sine, lag)
      even = series%cosine(i)*turned%c(i) + series%sine(i)*turned%s(i)
      odd = series%sine(i)*turned%c(i) - series%cosine(i)*turned%s(i)
      position = position - (even*versine + odd*lag)
      slope = slope - series%rate(i)*(even*sine + odd*versine)
    end do
  end subroutine series_in_frame

  !> Know a length of step.
  pure subroutine keep(damping, series, h, kept)
    real(wp), intent(in) :: damping          !! 2 xi
    type(harmonic_series_t), allocatable, intent(in) :: series   !! the flank, if it is one
    real(wp), intent(in) :: h                !! step
    type(kept_t), intent(inout) :: kept      !! of that length
    integer :: i
    kept%h = h
    call set_response(damping, h, kept%response)
    if (.not. allocated(series)) return
    do i = 1, size(series%rate)
      call set_harmonic(damping, series%rate(i), h, kept%from_cosine(:, i), kept%from_sine(:, i))
    end do
  end subroutine keep

  !> A harmonic in the frame: c cos rs + e sin rs less what it is and how it moves at s = 0, that is
  !> -c (1 - cos rs) - e (rs - sin rs). The quarters follow from the first by addition theorems
  !> whose terms do not cancel.
  pure subroutine set_harmonic(damping, rate, h, from_cosine, from_sine)
    real(wp), intent(in) :: damping, rate, h !! 2 xi, r, step
    real(wp), intent(out) :: from_cosine(6), from_sine(6)   !! for c = 1, and for e = 1
    real(wp) :: versine(4), sine(4), lag(4)  !! 1 - cos, sin, and rs less that
    real(wp) :: loss
    integer :: k
    call versed(0.25_wp*h*rate, versine(1), sine(1), lag(1))
    do k = 2, 4
      versine(k) = versine(1) + (versine(k - 1)*(1 - versine(1)) + sine(1)*sine(k - 1))
      sine(k) = sine(1)*(1 - versine(k - 1)) + sine(k - 1)*(1 - versine(1))
      lag(k) = (lag(1) + lag(k - 1)) + (sine(1)*versine(k - 1) + sine(k - 1)*versine(1))
    end do
    loss = damping*rate
    from_cosine(1:4) = -(versine + loss*sine)
    from_sine(1:4) = -(lag + loss*versine)
    from_cosine(5:6) = [-versine(4), -rate*sine(4)]
    from_sine(5:6) = [-lag(4), -rate*versine(4)]
  end subroutine set_harmonic

  !> The answers. A polynomial of A is p + q L, since L**2 = -1 - 2 xi L.
  pure subroutine set_response(damping, h, response)
    real(wp), intent(in) :: damping          !! 2 xi
    real(wp), intent(in) :: h                !! step
    real(wp), intent(out) :: response(6, 6)  !! see `kept_t`
    real(wp) :: a(2, 8)                      !! powers of A
    real(wp), dimension(2) :: one, half, whole, error, turned, first, second, coarse
    integer :: k
    one = [1.0_wp, 0.0_wp]
    a(:, 1) = [0.0_wp, h]
    do k = 2, 8
      a(:, k) = [-h*a(2, k - 1), h*(a(1, k - 1) - damping*a(2, k - 1))]
    end do
    ! Change of the state over half of the step, over all of it, and the correction: two halves
    ! multiplied out and a whole step, which differ from the fifth power on.
    half = a(:, 1)/2 + (a(:, 2)/8 + (a(:, 3)/48 + a(:, 4)/384))
    error = a(:, 5)/1920 + (a(:, 6)/13824 + (a(:, 7)/138240 + a(:, 8)/2211840))
    whole = a(:, 1) + (a(:, 2)/2 + (a(:, 3)/6 + (a(:, 4)/24 + (a(:, 5)/120 + (a(:, 6)/864 &
        + (a(:, 7)/8640 + a(:, 8)/138240))))))
    response(1:2, 1:2) = on_state(half)
    response(3:4, 1:2) = on_state(whole)
    response(5:6, 1:2) = on_state(error)
    ! By the force at the quarters: at the first, the second, the others; and under the whole step.
    turned = one/3 + (a(:, 1)/4 + (a(:, 2)*3/32 + (a(:, 3)*13/576 + (a(:, 4)/256 + (a(:, 5)/2304 &
        + a(:, 6)/36864)))))
    first = one/3 + (a(:, 1)/12 + a(:, 2)/96)
    second = one/6 + (a(:, 1)/12 + (a(:, 2)/48 + (a(:, 3)*5/1152 + a(:, 4)/4608)))
    coarse = one*2/3 + (a(:, 1)/3 + a(:, 2)/12)
    response(:, 3) = by_force(first, turned, turned)
    response(:, 4) = by_force(one/12, second, second - coarse)
    response(:, 5) = by_force(0*one, first, first)
    response(:, 6) = by_force(0*one, one/12, -one/12)

  contains

    !> p + q L as a matrix, column by column.
    pure function on_state(x) result(matrix)
      real(wp), intent(in) :: x(2)           !! p and q
      real(wp) :: matrix(2, 2)
      matrix(:, 1) = [x(1), -x(2)]
      matrix(:, 2) = [x(2), x(1) - damping*x(2)]
    end function on_state

    !> What a force does over half of the step, over both halves, extrapolated, and its correction.
    pure function by_force(middle, fine, difference) result(column)
      real(wp), intent(in), dimension(2) :: middle, fine, difference
      real(wp) :: column(6), correction(2)
      correction = richardson*difference
      column = h*[on_force(middle), on_force(fine + correction), on_force(correction)]
    end function by_force

    !> (p + q L) (0, 1).
    pure function on_force(x) result(vector)
      real(wp), intent(in) :: x(2)           !! p and q
      real(wp) :: vector(2)
      vector = [x(2), x(1) - damping*x(2)]
    end function on_force
  end subroutine set_response

  !> Two classical steps of the damped spring and one over both, extrapolated: `doubled_step`
  !> of flow/rk4/step.f90.
  pure subroutine spring_stages(damping, force, driven, kept, z, step)
    real(wp), intent(in) :: damping          !! 2 xi
    real(wp), intent(in) :: force            !! what drives it at s = 0
    real(wp), intent(in) :: driven(4)        !! and at the quarters of the step, beyond that
    type(kept_t), intent(in) :: kept         !! of the step's length
    real(wp), intent(in) :: z(2)             !! position and velocity at s = 0
    type(step_t), intent(inout) :: step      !! the result
    real(wp) :: x(6), middle(2)
    x = ((kept%response(:, 1)*(z(1) - force) + kept%response(:, 2)*z(2)) &
        + (kept%response(:, 3)*driven(1) + kept%response(:, 4)*driven(2))) &
        + (kept%response(:, 5)*driven(3) + kept%response(:, 6)*driven(4))
    middle = z + x(1:2)
    step%correction(1:2) = x(5:6)
    step%middle(1:2) = middle + 0.5_wp*x(5:6)
    step%end(1:2) = z + x(3:4)
    step%rate_begin(1:2) = [z(2), (force - z(1)) - damping*z(2)]
    step%rate_middle(1:2) = [middle(2), ((force + driven(2)) - middle(1)) - damping*middle(2)]
    step%rate_end(1:2) = [step%end(2), ((force + driven(4)) - step%end(1)) - damping*step%end(2)]
  end subroutine spring_stages

  !> What the stages give under a constant force, where the formula is exact.
  pure subroutine flight_stages(force, h, z, step)
    real(wp), intent(in) :: force            !! theta''
    real(wp), intent(in) :: h                !! step
    real(wp), intent(in) :: z(:)             !! position and velocity at s = 0
    type(step_t), intent(inout) :: step      !! the result
    real(wp) :: half
    half = 0.5_wp*h
    step%middle(1) = z(1) + half*(z(2) + 0.5_wp*half*force)
    step%middle(2) = z(2) + half*force
    step%end(1) = z(1) + h*(z(2) + half*force)
    step%end(2) = z(2) + h*force
    step%correction(1:2) = 0
    step%rate_begin(1:2) = [z(2), force]
    step%rate_middle(1:2) = [step%middle(2), force]
    step%rate_end(1:2) = [step%end(2), force]
  end subroutine flight_stages
end module lapwing_system_spring_stages
