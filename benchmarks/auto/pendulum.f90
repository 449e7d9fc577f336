! The forced, damped pendulum x'' + c x' + sin x = a cos(omega t) without impacts.
!
! U = (x, v, p, q): angle, angular velocity, and an oscillator whose limit cycle p = sin(omega t),
! q = cos(omega t) is the forcing, which makes the system autonomous. PAR(1) = omega, and the
! period stands in PAR(11).

MODULE pendulum
  IMPLICIT NONE
  DOUBLE PRECISION, PARAMETER :: TWO_PI = 6.28318530717958647692D0
  DOUBLE PRECISION, PARAMETER :: A = 0.15D0, C = 0.1D0, START = 1.2D0
END MODULE pendulum

SUBROUTINE FUNC(NDIM, U, ICP, PAR, IJAC, F, DFDU, DFDP)
  USE pendulum
  IMPLICIT NONE
  INTEGER, INTENT(IN) :: NDIM, ICP(*), IJAC
  DOUBLE PRECISION, INTENT(IN) :: U(NDIM), PAR(*)
  DOUBLE PRECISION, INTENT(OUT) :: F(NDIM)
  DOUBLE PRECISION, INTENT(INOUT) :: DFDU(NDIM, NDIM), DFDP(NDIM, *)
  DOUBLE PRECISION omega, s

  omega = PAR(1)
  s = U(3)**2 + U(4)**2
  F(1) = U(2)
  F(2) = A*U(4) - C*U(2) - SIN(U(1))
  F(3) = U(3)*(1 - s) + omega*U(4)
  F(4) = U(4)*(1 - s) - omega*U(3)
  IF (IJAC == 0) RETURN

  DFDU = 0
  DFDU(1, 2) = 1
  DFDU(2, 1) = -COS(U(1))
  DFDU(2, 2) = -C
  DFDU(2, 4) = A
  DFDU(3, 3) = 1 - s - 2*U(3)**2
  DFDU(3, 4) = omega - 2*U(3)*U(4)
  DFDU(4, 3) = -omega - 2*U(3)*U(4)
  DFDU(4, 4) = 1 - s - 2*U(4)**2
  IF (IJAC == 1) RETURN

  DFDP(1:4, 1) = [0D0, 0D0, U(4), -U(3)]
END SUBROUTINE FUNC

! The response of the linear oscillator, from which Newton's method finds the pendulum's.
SUBROUTINE STPNT(NDIM, U, PAR, T)
  USE pendulum
  IMPLICIT NONE
  INTEGER, INTENT(IN) :: NDIM
  DOUBLE PRECISION, INTENT(INOUT) :: U(NDIM), PAR(*)
  DOUBLE PRECISION, INTENT(IN) :: T
  DOUBLE PRECISION k, size, x, y

  PAR(1) = START
  PAR(11) = TWO_PI/START
  k = 1 - START**2
  size = A/(k**2 + (C*START)**2)
  x = size*k
  y = size*C*START
  U(3) = SIN(TWO_PI*T)
  U(4) = COS(TWO_PI*T)
  U(1) = x*U(4) + y*U(3)
  U(2) = START*(y*U(4) - x*U(3))
END SUBROUTINE STPNT

SUBROUTINE BCND
END SUBROUTINE BCND

SUBROUTINE ICND
END SUBROUTINE ICND

SUBROUTINE FOPT
END SUBROUTINE FOPT

SUBROUTINE PVLS
END SUBROUTINE PVLS
